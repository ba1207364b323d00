# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of tracks on KITTI's tracking sequences: HOTA, CLEAR-MOT and IDF1, through TrackEval."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from ..bags.locate import looks_like_bag
from ..bags.open_source import open_bag_source, open_folders
from ..files.remote import as_path
from ..kitti.label_file import find_frame_files
from ..kitti.names import SEQUENCE_DIGITS, SPLITS, TRACKING_LABELS, TXT
from ..kitti.store import STORE
from ..model.boxes import UNKNOWN_OCCLUSION
from ..model.errors import (
    KittiRos2Error,
    Loss,
    MissingPathError,
    UsageError,
    format_numbers,
    some_of,
)
from ..model.streams import Layout, Stream
from ..options.evaluation import TRACKING, make_tracking_options
from .bag_results import read_bag_results
from .box_mistakes import diagnose_tracks
from .ground_truth import recording_of
from .object_benchmark import left_out_note
from .track_metrics import (
    SCORED,
    TRACKER_CLASSES,
    ClassMap,
    TrackedSequence,
    check_trackeval,
    read_tracks,
    read_truth,
    score_sequences,
    tracks_of_frames,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Container, Iterable, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..kitti.kitti_recording import KittiRecording
    from ..model.boxes import Box
    from ..options.evaluation import BagResultsOptions
    from ..options.keywords import TrackingKeywords
    from ..options.read import ReadOptions
    from .track_metrics import Figures, TrackBoxes, TrackParts


# The sequences of tracking ground truth, and the files or the bag with a tracker's results.

if TYPE_CHECKING:
    Lengths = Mapping[str, int]

_SEQMAP = 'evaluate_tracking.seqmap'
_TRAINING_NAMES = frozenset(f'{number:0{SEQUENCE_DIGITS}d}' for number in range(21))
"""The sequences of KITTI's training split; those of testing are 0000 to 0028."""


class TruthSequence(NamedTuple):
    """A sequence with labels.

    Attributes:
        name: Sequence, such as 0000.
        labels: Its file in label_02.
        length: Number of frames.
        recording: The sequence, open.
    """

    name: str
    labels: Path
    length: int
    recording: KittiRecording


class ResultSource(NamedTuple):
    """The results of a tracker.

    Attributes:
        path: The requested path.
        sequences: Sequences with results, at least one.
        files: File of tracks by sequence.
        frames: Boxes by frame of the only sequence, None for files.
        losses: Sequences without results, and the losses of a bag.
        notes: One line each.
    """

    path: Path
    sequences: Sequence[TruthSequence]
    files: Mapping[str, Path]
    frames: Mapping[int, Iterable[Box]] | None = None
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def find_sequences(path: Path, read: ReadOptions) -> list[TruthSequence]:
    """Find the sequences with labels.

    Args:
        path: A tracking set or a split of it, label_02, or one of its files.
        read: Contains the sequence if only one is requested.

    Raises:
        KittiRos2Error: There is none.
    """
    if not path.exists():
        raise MissingPathError(path)
    folder, own = recording_of(path, read)
    if looks_like_bag(folder):
        raise UsageError(
            f'{path}: ground truth is a tracking set with {TRACKING_LABELS}, or a file of it'
        )
    recordings = open_folders(folder, replace(own, layout=Layout.TRACKING))
    sequences = []
    for recording in recordings:
        labels = recording.path(Stream.LABELS, 0)
        if labels.is_file():
            sequences.append(
                TruthSequence(recording.name, labels, _length(recording, labels), recording)
            )
    if not sequences:
        raise UsageError(
            f'{path}: has no {TRACKING_LABELS}/{"0" * SEQUENCE_DIGITS}{TXT} (KITTI publishes no'
            f' labels of {SPLITS[1]}); give {SPLITS[0]} of a tracking set'
        )
    return sequences


def _length(recording: KittiRecording, labels: Path) -> int:
    """Return the number of frames: of the files, or in the list of sequences of the devkit."""
    length = max((int(stream.numbers[-1]) + 1 for stream in recording.streams.values()), default=0)
    return max(length, _listed_length(recording.name, labels.parent))


def _listed_length(name: str, folder: Path) -> int:
    """Return a sequence's number of frames by the devkit's lists of its split; 0 without one.

    The devkit has evaluate_tracking.seqmap.training and .seqmap.test beside label_02, and copies of
    it .val and others. Sequences of both splits have the same names and other lengths.
    evaluate_tracking.seqmap names no split: it is read where no other file has the sequence, unless
    its content is the other split's.

    Args:
        name: Sequence, such as 0000.
        folder: label_02.
    """
    split = folder.parent
    folders = (split, folder, *([split.parent] if split.name in SPLITS else ()))
    testing = split.name == SPLITS[1]
    own: list[Lengths] = []
    plain: list[Lengths] = []
    others: list[Lengths] = []
    for directory in folders:
        for file_name in STORE.names(directory):
            if file_name == _SEQMAP:
                plain.append(_lengths_of(directory / file_name))
            elif file_name.startswith(f'{_SEQMAP}.'):
                is_test = file_name.removeprefix(f'{_SEQMAP}.').startswith('test')
                (own if is_test == testing else others).append(_lengths_of(directory / file_name))
    if not testing:
        allowed = _TRAINING_NAMES.union(_files(folder))
        plain = [table for table in plain if table not in others and table.keys() <= allowed]
    for lists in (own, plain):
        listed = [lengths[name] for lengths in lists if name in lengths]
        if listed:
            return max(listed)
    return 0


def _lengths_of(path: Path) -> Lengths:
    """Read the number of frames of each sequence; lines look like 0000 empty 000000 000154."""
    rows = (line.split() for line in STORE.read_text(path).splitlines())
    return {row[0]: int(row[3]) for row in rows if len(row) == 4 and row[3].isdecimal()}


def find_results(
    path: Path, sequences: Sequence[TruthSequence], options: BagResultsOptions, *, complete: bool
) -> ResultSource:
    """Find the results of sequences.

    Args:
        path: A folder of a tracker's files, directly or in its data/, one of them, or a bag.
        sequences: The sequences with labels.
        options: Options of a bag.
        complete: True if these are all sequences, so that results of others have no labels.

    Raises:
        KittiRos2Error: There are no results of these sequences.
    """
    if not path.exists():
        raise MissingPathError(path)
    if path.is_dir() and not looks_like_bag(path):
        return _from_folder(path, sequences, complete=complete)
    if path.suffix == TXT:
        return _from_file(path, sequences)
    if len(sequences) > 1:
        names = some_of([sequence.name for sequence in sequences])
        raise UsageError(
            f'{path}: a bag has the tracks of one sequence; choose it with --sequence ({names})'
        )
    with open_bag_source(path) as bag:
        results = read_bag_results(
            bag,
            options.topic,
            sequences[0].recording,
            dict(options.class_map),
            classes=TRACKER_CLASSES,
            tolerance_ns=options.tolerance_ns,
        )
    return ResultSource(path, sequences, {}, results.boxes, results.losses, results.notes)


def _from_file(path: Path, sequences: Sequence[TruthSequence]) -> ResultSource:
    named = [sequence for sequence in sequences if sequence.name == path.stem]
    chosen = sequences if len(sequences) == 1 else named
    if not chosen:
        raise UsageError(
            f'{path}: of which sequence are these tracks? choose it with --sequence'
            f' ({some_of([sequence.name for sequence in sequences])})'
        )
    return ResultSource(path, chosen, {chosen[0].name: path})


def _from_folder(path: Path, sequences: Sequence[TruthSequence], *, complete: bool) -> ResultSource:
    folder = find_frame_files(path, SEQUENCE_DIGITS)
    if folder is None:
        entries = STORE.names(path)
        content = f'contains {some_of(entries)}' if entries else 'the folder is empty'
        raise UsageError(
            f'{path}: {content}; expected tracks in files such as {sequences[0].name}{TXT}'
        )
    files = _files(folder)
    scored = [sequence for sequence in sequences if sequence.name in files]
    if not scored:
        names = some_of([f'{sequence.name}{TXT}' for sequence in sequences])
        raise UsageError(f'{folder}: has no {names}, but {some_of([f"{n}{TXT}" for n in files])}')
    absent = [sequence.name for sequence in sequences if sequence.name not in files]
    unknown = sorted({*files} - {sequence.name for sequence in sequences}) if complete else []
    lost = (
        Loss('tracks', len(absent), f'{folder}: no file of {some_of(absent, 6)}; not scored'),
        Loss('ground truth', len(unknown), f'{folder}: no labels of {some_of(unknown, 6)}'),
    )
    return ResultSource(path, scored, files, losses=tuple(loss for loss in lost if loss.count))


def _files(folder: Path) -> dict[str, Path]:
    """Return the files named like 0000.txt by sequence."""
    listing = STORE.list_numbered(folder, (TXT,), SEQUENCE_DIGITS)
    return {
        f'{number:0{SEQUENCE_DIGITS}d}': listing.path(number) for number in listing.numbers.tolist()
    }


if TYPE_CHECKING:
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
        sequences: The figures of each sequence.
        frames: Number of frames.
        losses: Unusable data, and sequences without results.
        notes: One line each.
        parts: TrackEval's own results, for combination with other sequences.
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
        options: Options of `kitti-ros2 eval tracking --help-all`, with underscores, same defaults:
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
    from ..api.arguments import by_name, warn_of  # noqa: PLC0415 - for the library only

    parsed = make_tracking_options(by_name(options, TRACKING))
    show = progress or (lambda _done, _total: None)
    scores = score_tracking(as_path(ground_truth), as_path(results), *parsed, show)
    warn_of(scores.losses)
    return scores


def score_tracking(
    ground_truth: Path,
    results: Path,
    read: ReadOptions,
    options: BagResultsOptions,
    progress: Progress,
    frames: Container[int] | None = None,
) -> TrackingScores:
    """Score tracks.

    Args:
        ground_truth: See evaluate_tracking.
        results: See evaluate_tracking.
        read: Options of the ground truth.
        options: Options of a bag.
        progress: Called with the number of sequences done, and of all.
        frames: The frames to score; None is all.

    Raises:
        KittiRos2Error: See evaluate_tracking.
    """
    check_trackeval()
    labelled = _labelled(ground_truth, results, read)
    complete = read.sequence is None and not ground_truth.is_file()
    source = find_results(results, labelled, options, complete=complete)
    classes = ClassMap(dict(options.class_map), TRACKER_CLASSES)
    losses, notes, others, occlusions = [*source.losses], [*source.notes], 0, Counter[int]()
    sequences = []
    for sequence in source.sequences:
        truth = read_truth(sequence.labels, sequence.length).among(frames)
        tracks = _read(source, sequence, classes).among(frames)
        losses += [*truth.losses, *tracks.losses]
        others += tracks.others
        occlusions.update(box.box.occluded for box in truth.boxes if box.class_name in SCORED)
        notes += [*_empty_frames(sequence, truth, tracks), *_short_tracks(sequence, tracks)]
        notes += diagnose_tracks(sequence.name, truth.boxes, tracks.boxes)
        sequences.append(TrackedSequence(sequence.name, sequence.length, truth.boxes, tracks.boxes))
    if others:
        names = ' and '.join(SCORED)
        notes.append(f'boxes of other classes than {names}, {others:,}, have no part in the scores')
    notes += left_out_note(occlusions[UNKNOWN_OCCLUSION], sum(occlusions.values()))
    figures = score_sequences(sequences, progress)
    return TrackingScores(
        figures.combined,
        figures.by_sequence,
        sum(_count(sequence.length, frames) for sequence in sequences),
        (*losses, *classes.losses(str(results))),
        tuple(notes),
        figures.parts,
    )


def _labelled(ground_truth: Path, results: Path, read: ReadOptions) -> list[TruthSequence]:
    """Return the sequences with labels; an error says so if the other path has them."""
    try:
        return find_sequences(ground_truth, read)
    except MissingPathError:
        raise
    except KittiRos2Error:
        if not _has_labels(results, read):
            raise
        raise UsageError(f'{results}: has the labels; give GT first, then RESULTS') from None


def _has_labels(path: Path, read: ReadOptions) -> bool:
    try:
        return bool(find_sequences(path, read))
    except (KittiRos2Error, OSError):
        return False


def _count(length: int, frames: Container[int] | None) -> int:
    """Count the scored frames of a sequence."""
    return length if frames is None else sum(number in frames for number in range(length))


def _read(source: ResultSource, sequence: TruthSequence, classes: ClassMap) -> TrackBoxes:
    """Read the tracks of a sequence."""
    if source.frames is not None:
        return tracks_of_frames(source.frames, source.path, sequence.length)
    return read_tracks(source.files[sequence.name], sequence.length, classes)


def _empty_frames(sequence: TruthSequence, truth: TrackBoxes, tracks: TrackBoxes) -> Sequence[str]:
    """Return a note on the frames of a sequence that have labels and no tracks."""
    labelled = {box.frame for box in truth.boxes if box.class_name in SCORED}
    missing = sorted(labelled - {box.frame for box in tracks.boxes})
    if not missing:
        return ()
    names = ' or '.join(SCORED)
    frames = format_numbers(missing)
    return (f'{sequence.name}: no {names} tracked in frames {frames}, which have labels of them',)


def _short_tracks(sequence: TruthSequence, tracks: TrackBoxes) -> Sequence[str]:
    """Return a note if each box is a track of its own, as of detections without ids."""
    count = len({(box.class_name, box.track_id) for box in tracks.boxes})
    if count < len(tracks.boxes) or count < 2:
        return ()
    return (
        f'{sequence.name}: every track has one box; a tracker gives the boxes of an object one id',
    )
