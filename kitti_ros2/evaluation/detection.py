# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of detections: KITTI's object benchmark on result files, or on results in a bag."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api.arguments import by_name, warn_of
from ..drawing.labelled_objects import BESIDE, compared, objects_of_boxes, plot_file
from ..files.remote import as_path
from ..kitti.names import parse_image_set
from ..kitti.store import STORE
from ..model.boxes import DONT_CARE, Difficulty, Verdict
from ..model.classes import KITTI_OVERLAPS, LeastOverlaps
from ..model.errors import Loss, UsageError, describe_frames, format_count, some_of
from ..model.geometry import Transform
from ..model.samples import FrameLabels
from ..options.declare import options_of
from ..options.evaluation import DETECTION, BagResultsOptions, make_detection_options
from .box_mistakes import diagnose_detections
from .ground_truth import (
    FrameBoxes,
    holds_bag,
    open_truth_bag,
    read_boxes,
    read_ground_truth,
    recording_of,
)
from .object_benchmark import (
    SAMPLES,
    Space,
    evaluate_class,
    find_overlaps,
    notes_on,
    select_class,
    table_of,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..drawing.labelled_objects import LabelledObject
    from ..model.boxes import Box
    from ..options.evaluation import DetectionOptions
    from ..options.keywords import DetectionKeywords
    from ..options.read import ReadOptions
    from ..own_bags.recording import NumberedRecording
    from .ground_truth import Progress
    from .object_benchmark import Curve, ObjectTable, Overlaps, Scores


# Labels and results from files, folders and bags.


def no_progress() -> None:
    """Show no progress."""


def read_frames(
    ground_truth: Path,
    results: Path,
    read: ReadOptions,
    recorded: BagResultsOptions,
    progress: Progress = no_progress,
) -> tuple[FrameBoxes, FrameBoxes]:
    """Read labels and results by frame.

    Args:
        ground_truth: The labels.
        results: Result files, or a bag.
        read: Layout and sequence of the ground truth.
        recorded: Options of a bag.
        progress: Called for each file that is read.

    Raises:
        KittiRos2Error: A path cannot be read.
    """
    in_bag = holds_bag(results)
    if not in_bag:
        _refuse_bag_options(results, recorded)
    truth = read_ground_truth(ground_truth, read, progress)
    if in_bag:
        detections = _read_bag(results, ground_truth, read, recorded)
    else:
        detections = read_boxes(results, 'results', progress, truth.frames)
    labelled, detected = _scores(truth), _scores(detections)
    if labelled and None not in labelled and {*detected} == {None}:
        raise UsageError(
            f'{ground_truth}: all labels have scores, and {results} has none; give GROUND_TRUTH'
            f' first, then RESULTS'
        )
    return truth, detections


def _refuse_bag_options(results: Path, recorded: BagResultsOptions) -> None:
    for option in options_of(BagResultsOptions):
        if results.exists() and getattr(recorded, option.field) != option.default:
            name = option.name.replace('_', '-')
            raise UsageError(f'{results}: is no bag; --{name} is for results in a bag')


def _scores(frames: FrameBoxes) -> list[float | None]:
    return [box.score for boxes in frames.boxes.values() for box in boxes]


def _read_bag(
    path: Path, ground_truth: Path, read: ReadOptions, options: BagResultsOptions
) -> FrameBoxes:
    """Read the results in a bag; the ground truth has the stamps and calibrations of the frames."""
    from ..bags.open_source import open_bag_source, open_folder  # noqa: PLC0415 - as below
    from .bag_results import read_bag_results  # noqa: PLC0415 - readers of bags take 0.2 s

    with ExitStack() as exit_stack:
        recording: NumberedRecording
        if holds_bag(ground_truth):
            recording = exit_stack.enter_context(open_truth_bag(ground_truth))
        else:
            recording = open_folder(*recording_of(ground_truth, read))
        recorded = read_bag_results(
            exit_stack.enter_context(open_bag_source(path)),
            options.topic,
            recording,
            dict(options.class_map),
            tolerance_ns=options.tolerance_ns,
        )
    return FrameBoxes(path, recorded.boxes, losses=recorded.losses, notes=recorded.notes)


# The frames that have both labels and results; all others are losses.


def common_frames(
    truth: FrameBoxes, results: FrameBoxes, listed: Path | None
) -> tuple[list[int], list[Loss]]:
    """Return the frames to score, and all losses: also the frames that cannot be scored.

    Args:
        truth: The labels.
        results: The results.
        listed: A list of the frames to score; None for all with labels and results.

    Raises:
        UsageError: No frame can be scored.
    """
    labelled, answered = ({*side.boxes, *_unread(side)} for side in (truth, results))
    chosen, losses = (labelled | answered, []) if listed is None else _read_list(listed, truth)
    losses += [loss for side in (truth, results) for loss in side.losses if _concerns(loss, chosen)]
    labelled |= chosen if truth.complete else set()
    answered |= labelled if results.complete else set()
    absent = sorted((chosen & labelled) - answered)
    if absent:
        message = (
            f'{results.source}: no file for frames {{}}, which are not scored (give an empty file'
            f' for a frame without detections, or --frame-list with a list of the frames to score)'
        )
        losses.append(Loss('results', len(absent), message, tuple(absent)))
    extra = sorted(chosen - labelled)
    if extra:
        message = f'{truth.source}: no labels for frames {{}}, which are not scored'
        losses.append(Loss('ground truth', len(extra), message, tuple(extra)))
    unread = {*_unread(truth), *_unread(results)}
    numbers = sorted((chosen & labelled & answered) - unread)
    if not numbers:
        raise _no_frames(truth, results, listed)
    return numbers, losses


def _concerns(loss: Loss, numbers: set[int]) -> bool:
    return not loss.numbers or not numbers.isdisjoint(loss.numbers)


def _unread(frames: FrameBoxes) -> set[int]:
    """Return the frames whose file could not be read."""
    return {number for loss in frames.losses for number in loss.numbers} - frames.boxes.keys()


def _read_list(path: Path, truth: FrameBoxes) -> tuple[set[int], list[Loss]]:
    """Read the numbers of a list of frames; its invalid lines are losses."""
    names = truth.frames
    image_set = parse_image_set(STORE.read_text(path), path, frames=True, file_names=names)
    losses = [Loss('frames', 1, reason) for reason in image_set.invalid]
    numbers = (names.number(name) for name in image_set.entries)
    return {number for number in numbers if number is not None}, losses


def _no_frames(truth: FrameBoxes, results: FrameBoxes, listed: Path | None) -> UsageError:
    for side in (results, truth):
        if side.losses and not side.boxes:
            return UsageError(f'{side.source}: no frame can be scored: {side.losses[0].text()}')
    described = [
        f'{side.source} has {describe_frames(sorted(side.boxes)) if side.boxes else "no frames"}'
        for side in (results, truth)
    ]
    among = f' among those of {listed}' if listed is not None else ''
    lost = [loss for side in (results, truth) if not side.boxes for loss in side.losses]
    reason = f' ({max(lost, key=lambda loss: loss.count).text()})' if lost else ''
    return UsageError(
        f'no frame{among} has both results and labels: {", ".join(described)}{reason};'
        f' give the results of these frames, or their labels'
    )


# The frames with the most errors of a detector.

_COUNT = 20


@dataclass(frozen=True)
class WorstFrame:
    """A frame with errors.

    Attributes:
        number: The frame.
        penalty: The number of missed labels and the weights of the false positives, summed.
        missed: The number of labels without a matching prediction.
        false_positives: The number of predictions without a matching label.
        reason: The errors, one line.
    """

    number: int
    penalty: float
    missed: int
    false_positives: int
    reason: str


def worst_frames(
    ground_truth: Mapping[int, Sequence[Box]],
    results: Mapping[int, Sequence[Box]],
    count: int = _COUNT,
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
    *,
    classes: Collection[str] = (),
) -> list[WorstFrame]:
    """Rank frames by their errors: each missed label is 1, each false positive its score.

    Labels and predictions are matched as in pictures (model/boxes.py). Scores that are not all
    within 0 to 1 are scaled to it, from the lowest to the highest; predictions without a score are
    1. Of frames with equal errors the lower number is first; frames without errors are left out.

    Args:
        ground_truth: The labels of the frames to rank, by number.
        results: The predictions by number; a frame that is not in it has none.
        count: Number of frames to return, at most.
        overlaps: The IoU above which a prediction is a true positive.
        classes: Classes whose errors count, in lower case; empty for all.
    """
    weigh = _weight(results)
    worst = []
    for number, boxes in ground_truth.items():
        labels, predictions = compared(_objects(boxes), _objects(results.get(number, ())), overlaps)
        missed = _with_verdict(labels, Verdict.FALSE_NEGATIVE, classes)
        wrong = _with_verdict(predictions, Verdict.FALSE_POSITIVE, classes)
        if missed or wrong:
            wrong.sort(key=weigh, reverse=True)
            penalty = len(missed) + sum(map(weigh, wrong))
            reason = _reason(missed, wrong)
            worst.append(WorstFrame(number, penalty, len(missed), len(wrong), reason))
    return sorted(worst, key=lambda frame: (-frame.penalty, frame.number))[:count]


def _objects(boxes: Sequence[Box]) -> list[LabelledObject]:
    """Return boxes as objects in the camera's frame, in which overlaps are the same."""
    return objects_of_boxes(FrameLabels(boxes), Transform.identity())


def _with_verdict(
    objects: Sequence[LabelledObject], verdict: Verdict, classes: Collection[str]
) -> list[LabelledObject]:
    return [
        obj
        for obj in objects
        if obj.match is not None
        and obj.match.verdict is verdict
        and (not classes or obj.class_name.lower() in classes)
    ]


def _weight(results: Mapping[int, Sequence[Box]]) -> Callable[[LabelledObject], float]:
    """Return the function of the weight of a false positive, 0 to 1."""
    scores = [box.score for boxes in results.values() for box in boxes if box.score is not None]
    low, high = min(scores, default=0.0), max(scores, default=1.0)
    if low >= 0 and high <= 1:
        low, high = 0.0, 1.0
    span = high - low
    return lambda obj: (obj.score - low) / span if span and obj.score is not None else 1.0


def _reason(missed: Sequence[LabelledObject], wrong: Sequence[LabelledObject]) -> str:
    """Describe errors: missed: 2 Car, 1 Cyclist; false positives: Car 0.93, Car 0.81."""
    parts = []
    if missed:
        classes = Counter(obj.class_name for obj in missed).most_common()
        parts.append(f'missed: {", ".join(f"{n} {class_name}" for class_name, n in classes)}')
    if wrong:
        named = [
            obj.class_name if obj.score is None else f'{obj.class_name} {obj.score:.2f}'
            for obj in wrong
        ]
        noun = 'false positive' if len(wrong) == 1 else 'false positives'
        parts.append(f'{noun}: {some_of(named)}')
    return '; '.join(parts)


ORIENTATION = 'aos'
LOOSE = {'car': 0.5, 'pedestrian': 0.25, 'cyclist': 0.25}
"""Overlaps of the second table that most papers print, for boxes on the ground and in space."""

_NO_ANGLE = -10.0
_NO_LOCATION = -1000.0


@dataclass(frozen=True)
class DetectionScores:
    """The scores of detections by the rules of KITTI's object benchmark.

    Attributes:
        scores: Curves by class in lower case, metric (3d, bev, 2d, aos) and Difficulty; r40 and
            r11 of a curve are percent. None where the devkit evaluates nothing: no detection of the
            class has such a box, or, for aos, a detection has the invalid alpha -10.
        loose: Curves with the loose overlaps, in bev and 3d; empty unless requested.
        limits: The overlap above which a detection matches, by class.
        frames: Number of frames that were scored.
        losses: Frames, files and lines that were not scored.
        notes: Unusual figures, one line each.
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
        options: Options of `kitti-ros2 eval detection --help-all`, with the same defaults:
            classes={'car': 0.7, 'truck': 0.5}, frames='ImageSets/val.txt', loose=True, worst=20.

    Returns:
        The scores. Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: A path cannot be read, no frame has both, or an option is invalid.

    Examples:
        >>> from kitti_ros2 import evaluation
        >>> scores = evaluation.evaluate_detection('object/training', 'object/training/label_2')
        >>> scores.frames, scores.scores['car']['3d']['moderate'].r40
        (..., ...)
    """
    read, chosen, recorded = make_detection_options(by_name(options, DETECTION))
    show = progress or no_progress
    scores = score_detection(as_path(ground_truth), as_path(results), read, chosen, recorded, show)
    warn_of(scores.losses)
    return scores


def score_detection(
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
        options: Classes, overlaps and frames to score.
        recorded: Options of a bag.
        progress: Called for each file that is read.

    Raises:
        KittiRos2Error: A path cannot be read, or no frame has both.
    """
    return score_frames(*read_frames(ground_truth, results, read, recorded, progress), options)


def score_frames(
    truth: FrameBoxes, results: FrameBoxes, options: DetectionOptions
) -> DetectionScores:
    """Score results by frame with labels by frame.

    Raises:
        KittiRos2Error: No frame has both.
    """
    numbers, losses = common_frames(truth, results, options.frames)
    labels, detections = (
        table_of([side.boxes.get(number, ()) for number in numbers]) for side in (truth, results)
    )
    limits = options.limits
    loose = {name: LOOSE[name] for name in limits if options.loose and name in LOOSE}
    overlaps = find_overlaps(labels, detections, min([*limits.values(), *loose.values()]))
    scores = {
        name: _score_class(labels, detections, overlaps, name, limit)
        for name, limit in limits.items()
    }
    named = str(results.source), limits.keys(), labels, detections, numbers
    notes = (*notes_on(scores, results, labels, detections), *diagnose_detections(*named))
    solid = {space: overlaps[space] for space in (Space.SOLID, Space.GROUND)}
    return DetectionScores(
        scores,
        {name: _score_class(labels, detections, solid, name, at) for name, at in loose.items()},
        limits,
        len(numbers),
        tuple(losses),
        (*truth.notes, *results.notes, *notes),
        None if options.worst is None else _rank(truth, results, numbers, options),
    )


def _rank(
    truth: FrameBoxes, results: FrameBoxes, numbers: Sequence[int], options: DetectionOptions
) -> tuple[WorstFrame, ...]:
    """Return the frames with the most errors, of those that are scored."""
    labels, detections = (
        {number: side.boxes.get(number, ()) for number in numbers} for side in (truth, results)
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
    angles = Space.IMAGE in spaces and not _has_invalid_alpha(detections)
    by_metric: dict[str, dict[Difficulty, Curve | None]] = {space.value: {} for space in overlaps}
    by_metric |= {ORIENTATION: {}} if Space.IMAGE in overlaps else {}
    for level in Difficulty:
        objects = select_class(labels, detections, class_name, level)
        for space, pairs in overlaps.items():
            curves = evaluate_class(objects, pairs, limit)
            by_metric[space.value][level] = curves.precision if space in spaces else None
            if space is Space.IMAGE:
                by_metric[ORIENTATION][level] = curves.similarity if angles else None
    return by_metric


def _evaluated(detections: ObjectTable, class_name: str) -> set[Space]:
    """Return the spaces in which the devkit evaluates a class: a detection has a box there.

    Source: eval_image, eval_ground and eval_3d in loadDetections of evaluate_object.cpp. A box in
    the image counts there if its left edge is not negative. A class without any detection is not
    evaluated by the devkit; here it is, with a precision of 0.
    """
    own = detections.of_classes({class_name})
    if not own.any():
        return {*Space}
    x, y, z = (detections.location[own] != _NO_LOCATION).T
    height, width, length = (detections.size_hwl[own] > 0).T
    boxes = {
        Space.IMAGE: detections.box_2d[own, 0] >= 0,
        Space.GROUND: x & z & width & length,
        Space.SOLID: x & y & z & height & width & length,
    }
    return {space for space, have in boxes.items() if have.any()}


def _has_invalid_alpha(detections: ObjectTable) -> bool:
    """Return whether the devkit computes no AOS, for any class: a detection has alpha -10.

    Source: compute_aos in loadDetections of evaluate_object.cpp. DontCare lines, which have no
    place in results but do in labels that are scored as results, are skipped here.
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


# Drawing of the curves of precision and orientation similarity over recall.

_PANEL_INCHES = (3.4, 2.3)
_TITLES = {'2d': '2D', 'aos': 'orientation', 'bev': "bird's-eye view", '3d': '3D'}
_LINE_STYLES = {
    Difficulty.EASY: ('#2a9d5c', (0, ())),
    Difficulty.MODERATE: ('#e0861a', (0, (5, 1.5))),
    Difficulty.HARD: ('#c03a4b', (0, (2, 1.2))),
}


def draw_curves(scores: DetectionScores, title: str, path: Path) -> None:
    """Draw a row of panels for each class, with a curve for each level of difficulty.

    Args:
        scores: The scores.
        title: The heading.
        path: The picture: .png, .pdf or .svg.

    Raises:
        ImportError: matplotlib is not installed.
        OSError: The file cannot be written.
    """
    width, height = _PANEL_INCHES
    rows = len(scores.scores)
    with plot_file(path, (width * len(_TITLES), height * rows + 0.4)) as figure:
        grid = figure.subplots(rows, len(_TITLES), squeeze=False, sharex=True, sharey=True)
        heading = f'{title}, {format_count(scores.frames, "frame")}'
        figure.suptitle(heading, size=11, weight='bold')
        for row, (class_name, metrics) in zip(grid, scores.scores.items(), strict=True):
            row[0].set_ylabel('precision, %')
            for axes, (metric, name) in zip(row, _TITLES.items(), strict=True):
                axes.set_title(f'{class_name}, {name}', loc='left')
                _draw(axes, metrics[metric])
        for axes in grid[-1]:
            axes.set_xlabel('recall, %')


def _draw(axes: Any, curves: Mapping[Difficulty, Curve | None]) -> None:  # noqa: ANN401 - of matplotlib
    """Draw the curves of a class in one metric, with their averages."""
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 103)
    recall = 100 * np.arange(SAMPLES) / (SAMPLES - 1)
    for level, curve in curves.items():
        if curve is not None and curve.objects:
            color, dashes = _LINE_STYLES[level]
            label = f'{level.value} {curve.r40:.2f}'
            axes.plot(recall, 100 * curve.values, color=color, ls=dashes, lw=1.4, label=label)
    if axes.lines:
        axes.legend(title='R40', **BESIDE)
    else:
        axes.text(50, 50, 'no objects, or not evaluated', ha='center', va='center')
