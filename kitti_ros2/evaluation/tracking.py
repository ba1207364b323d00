# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of tracks on KITTI's tracking sequences: HOTA, CLEAR-MOT and IDF1, through TrackEval."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..files.remote import as_path
from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.losses import format_numbers
from ..options.evaluation_tables import TRACKING, make_tracking_options
from .class_map import ClassMap
from .result_notes import left_out_note
from .track_boxes import SCORED, TRACKER_CLASSES, read_tracks, read_truth, tracks_of_frames
from .track_metrics import TrackedSequence, check_trackeval, score_sequences
from .track_sources import find_results, find_sequences

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Container, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..api.keywords import TrackingKeywords
    from ..model.losses import Loss
    from ..options.bag_results import BagResultsOptions
    from ..options.read import ReadOptions
    from .track_boxes import TrackBoxes
    from .track_metrics import Figures, TrackParts
    from .track_sources import ResultSource, TruthSequence

    Progress = Callable[[int, int], None]

__all__ = ['TrackingScores', 'evaluate_tracking']


@dataclass(frozen=True)
class TrackingScores:
    """The scores of tracks.

    The figures have TrackEval's names: HOTA, DetA, AssA, LocA, MOTA, MOTP, IDF1, IDP and IDR in
    percent, None of a class that neither labels nor tracks have; IDSW (switches of id), Frag, MT,
    PT, ML, CLR_TP, CLR_FN and CLR_FP as counts.

    Attributes:
        classes: By class (car, pedestrian) the figures of all sequences together.
        sequences: The same of each sequence.
        frames: Number of frames.
        losses: What could not be used, and sequences without results.
        notes: Remarks.
        parts: TrackEval's own results, of which those of other sequences together can be made.
    """

    classes: Mapping[str, Figures]
    sequences: Mapping[str, Mapping[str, Figures]]
    frames: int
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    parts: TrackParts = field(default_factory=dict)


def evaluate_tracking(
    ground_truth: str | os.PathLike[str],
    results: str | os.PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Unpack[TrackingKeywords],
) -> TrackingScores:
    """Score tracks, as `kitti-ros2 eval tracking` does.

    Args:
        ground_truth: A tracking set with label_02, one of its files, or label_02 itself.
        results: A folder of a tracker's files (0000.txt), one of them, or a bag.
        progress: Called with the number of sequences done, and of all.
        options: Those of `kitti-ros2 eval tracking --help`, with underscores and the same defaults:
            sequence='0000', topic='/tracks', class_map={'car': 'Car'}, tolerance=0.05.

    Returns:
        The scores, losses and notes. Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: The ground truth, the results or an option is invalid, or TrackEval is not
            installed.

    Examples:
        >>> from kitti_ros2.evaluation import evaluate_tracking
        >>> scores = evaluate_tracking('tracking', 'tracks')  # doctest: +SKIP
        >>> scores.classes['car']['HOTA'], scores.classes['car']['IDSW']  # doctest: +SKIP
    """
    from ..api.keywords import by_name  # noqa: PLC0415 - for the library only
    from ..api.source import warn  # noqa: PLC0415 - pictures

    given = make_tracking_options(by_name(options, TRACKING))
    show = progress or (lambda _done, _total: None)
    found = score_tracking(as_path(ground_truth), as_path(results), *given, show)
    for loss in found.losses:
        warn(loss.text())
    return found


def score_tracking(
    ground_truth: Path,
    results: Path,
    read: ReadOptions,
    options: BagResultsOptions,
    progress: Progress,
    played: Container[int] | None = None,
) -> TrackingScores:
    """Score tracks.

    Args:
        ground_truth: See evaluate_tracking.
        results: The same.
        read: Options of the ground truth.
        options: Those of a bag.
        progress: Called with the number of sequences done, and of all.
        played: The frames to score; None is all.

    Raises:
        KittiRos2Error: As evaluate_tracking.
    """
    check_trackeval()
    known = find_sequences(ground_truth, read)
    all_known = read.sequence is None and not ground_truth.is_file()
    source = find_results(results, known, options, all_known=all_known)
    classes = ClassMap(dict(options.class_map), TRACKER_CLASSES)
    losses, notes, others, unknown = [*source.losses], [*source.notes], 0, 0
    sequences = []
    for each in source.sequences:
        truth = read_truth(each.labels, each.length).among(played)
        tracks = _read(source, each, classes).among(played)
        losses += [*truth.losses, *tracks.losses]
        others += tracks.others
        unknown += sum(
            each.class_name in SCORED and each.box.occluded == UNKNOWN_OCCLUSION
            for each in truth.boxes
        )
        notes += [*_empty_frames(each, truth, tracks), *_short_tracks(each, tracks)]
        sequences.append(TrackedSequence(each.name, each.length, truth.boxes, tracks.boxes))
    if others:
        names = ' and '.join(SCORED)
        notes.append(f'boxes of other classes than {names}, {others:,}, have no part in the scores')
    notes += left_out_note(unknown)
    figures = score_sequences(sequences, progress)
    return TrackingScores(
        figures.combined,
        figures.by_sequence,
        sum(_count(each.length, played) for each in sequences),
        (*losses, *classes.losses(str(results))),
        tuple(notes),
        figures.parts,
    )


def _count(length: int, played: Container[int] | None) -> int:
    """Return how many frames of a sequence are scored."""
    return length if played is None else sum(number in played for number in range(length))


def _read(source: ResultSource, sequence: TruthSequence, classes: ClassMap) -> TrackBoxes:
    """Read the tracks of a sequence."""
    if source.frames is not None:
        return tracks_of_frames(source.frames, source.path, sequence.length)
    return read_tracks(source.files[sequence.name], sequence.length, classes)


def _empty_frames(sequence: TruthSequence, truth: TrackBoxes, tracks: TrackBoxes) -> Sequence[str]:
    """Return a note on the frames of a sequence that have labels and no tracks."""
    labelled = {each.frame for each in truth.boxes if each.class_name in SCORED}
    missing = sorted(labelled - {each.frame for each in tracks.boxes})
    if not missing:
        return ()
    names = ' or '.join(SCORED)
    frames = format_numbers(missing)
    return (f'{sequence.name}: no {names} tracked in frames {frames}, which have labels of them',)


def _short_tracks(sequence: TruthSequence, tracks: TrackBoxes) -> Sequence[str]:
    """Return a note if each box is a track of its own, as of detections without ids."""
    count = len({(each.class_name, each.track_id) for each in tracks.boxes})
    if count < len(tracks.boxes) or count < 2:
        return ()
    return (
        f'{sequence.name}: every track has one box; a tracker gives the boxes of an object one id',
    )
