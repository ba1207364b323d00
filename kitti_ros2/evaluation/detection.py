# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of detections: KITTI's object benchmark on result files, or on results in a bag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..api.keywords import by_name
from ..api.source import warn
from ..files.remote import as_path
from ..model.boxes import DONT_CARE
from ..model.difficulty import Difficulty
from ..options.evaluation_tables import DETECTION, make_detection_options
from .common_frames import common_frames
from .detection_inputs import no_progress, read_frames
from .object_benchmark import evaluate_class, select_class
from .object_table import table_of
from .overlap import Space, find_overlaps
from .result_notes import notes_on
from .worst import worst_frames

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..api.keywords import DetectionKeywords
    from ..model.losses import Loss
    from ..options.bag_results import BagResultsOptions
    from ..options.eval_detection import DetectionOptions
    from ..options.read import ReadOptions
    from .frame_boxes import FrameBoxes, Progress
    from .object_benchmark import Curve, Scores
    from .object_table import ObjectTable
    from .overlap import Overlaps
    from .worst import WorstFrame

ORIENTATION = 'aos'
LOOSE = {'car': 0.5, 'pedestrian': 0.25, 'cyclist': 0.25}
"""Overlaps of the second table that most papers print, for boxes on the ground and in space."""

_NO_ANGLE = -10.0
_NO_PLACE = -1000.0


@dataclass(frozen=True)
class DetectionScores:
    """The scores of detections by the rules of KITTI's object benchmark.

    Attributes:
        scores: Curves by class in lower case, metric (3d, bev, 2d, aos) and Difficulty; r40 and
            r11 of a curve are percent. None where the devkit evaluates nothing: no detection of the
            class has such a box, or, for aos, a detection has the invalid alpha -10.
        loose: The same with the loose overlaps, in bev and 3d; empty unless requested.
        limits: The overlap above which a detection matches, by class.
        frames: Number of frames that were scored.
        losses: Frames, files and lines that were not scored.
        notes: Remarks on figures that may surprise, one line each.
        worst: The frames with the most errors; None unless requested.
    """

    scores: Scores
    loose: Scores
    limits: Mapping[str, float]
    frames: int
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    worst: tuple[WorstFrame, ...] | None = None

    def percent(self) -> dict[str, object]:
        """Return the figures as plain values: by class, metric and level R40 and R11, percent."""
        loose = {'loose': _plain(self.loose)} if self.loose else {}
        return {'detection': _plain(self.scores), **loose, 'frames': self.frames}


def evaluate_detection(
    ground_truth: str | os.PathLike[str],
    results: str | os.PathLike[str],
    *,
    progress: Progress | None = None,
    **options: Unpack[DetectionKeywords],
) -> DetectionScores:
    """Score detections as KITTI's object benchmark does, as `kitti-ros2 eval detection`.

    Args:
        ground_truth: label_2, a split or root of the object layout, a tracking label file, or the
            folder of a recording with labels.
        results: A folder of result files, NNNNNN.txt, a tracker's file, or a bag.
        progress: Called for each file that is read.
        options: Those of `kitti-ros2 eval detection --help`, with the same defaults:
            classes={'car': 0.7, 'truck': 0.5}, frames='ImageSets/val.txt', loose=True, worst=20.

    Returns:
        The scores. Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: A path cannot be read, no frame has both, or an option is invalid.

    Examples:
        >>> from kitti_ros2 import evaluation
        >>> found = evaluation.evaluate_detection('object/training', 'object/training/label_2')
        >>> found.frames, found.scores['car']['3d']['moderate'].r40
        (..., ...)
    """
    read, chosen, recorded = make_detection_options(by_name(options, DETECTION))
    show = progress or no_progress
    found = score_paths(as_path(ground_truth), as_path(results), read, chosen, recorded, show)
    for loss in found.losses:
        warn(loss.text())
    return found


def score_paths(
    ground_truth: Path,
    results: Path,
    read: ReadOptions,
    options: DetectionOptions,
    recorded: BagResultsOptions,
    progress: Progress = no_progress,
) -> DetectionScores:
    """Score the results at a path with the labels at another.

    Args:
        ground_truth: The labels.
        results: Result files, or a bag.
        read: Layout and sequence of the ground truth.
        options: What is scored.
        recorded: Options of a bag.
        progress: Called for each file that is read.

    Raises:
        KittiRos2Error: A path cannot be read, or no frame has both.
    """
    return score_frames(*read_frames(ground_truth, results, read, recorded, progress), options)


def score_frames(
    truth: FrameBoxes, found: FrameBoxes, options: DetectionOptions
) -> DetectionScores:
    """Score results by frame with labels by frame.

    Raises:
        KittiRos2Error: No frame has both.
    """
    numbers, losses = common_frames(truth, found, options.frames)
    labels, detections = (
        table_of([each.boxes.get(number, ()) for number in numbers]) for each in (truth, found)
    )
    limits = options.limits
    loose = {name: LOOSE[name] for name in limits if options.loose and name in LOOSE}
    overlaps = find_overlaps(labels, detections, min([*limits.values(), *loose.values()]))
    scores = {
        name: _score_class(labels, detections, overlaps, name, limit)
        for name, limit in limits.items()
    }
    solid = {space: overlaps[space] for space in (Space.SOLID, Space.GROUND)}
    return DetectionScores(
        scores,
        {name: _score_class(labels, detections, solid, name, at) for name, at in loose.items()},
        limits,
        len(numbers),
        tuple(losses),
        (*truth.notes, *found.notes, *notes_on(scores, found, labels, detections)),
        None if options.worst is None else _rank(truth, found, numbers, options),
    )


def _rank(
    truth: FrameBoxes, found: FrameBoxes, numbers: Sequence[int], options: DetectionOptions
) -> tuple[WorstFrame, ...]:
    """Return the frames with the most errors, of those that are scored."""
    labels, detections = (
        {number: each.boxes.get(number, ()) for number in numbers} for each in (truth, found)
    )
    count = options.worst or 0
    ranked = worst_frames(
        labels, detections, count, options.overlaps, classes=options.limits.keys()
    )
    return tuple(ranked)


def _score_class(
    labels: ObjectTable,
    detections: ObjectTable,
    overlaps: Mapping[Space, Overlaps],
    class_name: str,
    limit: float,
) -> dict[str, dict[Difficulty, Curve | None]]:
    """Return the curves of a class by metric and level."""
    spaces = _evaluated(detections, class_name)
    angles = Space.IMAGE in spaces and not _lacks_angle(detections)
    found: dict[str, dict[Difficulty, Curve | None]] = {space.value: {} for space in overlaps}
    found |= {ORIENTATION: {}} if Space.IMAGE in overlaps else {}
    for level in Difficulty:
        objects = select_class(labels, detections, class_name, level)
        for space, pairs in overlaps.items():
            curves = evaluate_class(objects, pairs, limit)
            found[space.value][level] = curves.precision if space in spaces else None
            if space is Space.IMAGE:
                found[ORIENTATION][level] = curves.similarity if angles else None
    return found


def _evaluated(detections: ObjectTable, class_name: str) -> set[Space]:
    """Return the spaces in which the devkit evaluates a class: a detection has a box there.

    Source: eval_image, eval_ground and eval_3d in loadDetections of evaluate_object.cpp. A box in
    the image counts there if its left edge is not negative. A class without any detection is not
    evaluated by the devkit; here it is, with a precision of 0.
    """
    own = detections.of_classes({class_name})
    if not own.any():
        return {*Space}
    x, y, z = (detections.location[own] != _NO_PLACE).T
    height, width, length = (detections.size_hwl[own] > 0).T
    boxes = {
        Space.IMAGE: detections.box_2d[own, 0] >= 0,
        Space.GROUND: x & z & width & length,
        Space.SOLID: x & y & z & height & width & length,
    }
    return {space for space, have in boxes.items() if have.any()}


def _lacks_angle(detections: ObjectTable) -> bool:
    """Whether the devkit computes no AOS, for any class: a detection has alpha -10.

    Source: compute_aos in loadDetections of evaluate_object.cpp. DontCare lines, which have no
    place in results but do in labels that are scored as results, are passed over here.
    """
    invalid = (detections.alpha == _NO_ANGLE) & ~detections.of_classes({DONT_CARE.lower()})
    return bool(invalid.any())


def _plain(scores: Scores) -> dict[str, object]:
    return {
        name: {
            metric: {
                level.value: {
                    'R40': _figure(curve, 'r40'),
                    'R11': _figure(curve, 'r11'),
                }
                for level, curve in levels.items()
            }
            for metric, levels in metrics.items()
        }
        for name, metrics in scores.items()
    }


def _figure(curve: Curve | None, name: str) -> float | None:
    """Return an average precision in percent; None without an object, or not evaluated."""
    return None if curve is None or not curve.objects else round(getattr(curve, name), 4)
