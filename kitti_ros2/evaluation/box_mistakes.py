# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The usual mistakes behind absurd scores of detections, told from boxes that are otherwise right.

Each row of the tables undoes a mistake. If results then agree with the ground truth, and did not
before, that was it: a note names it. Scores never change.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..model.boxes import DONT_CARE, LIMITS, ious_2d, parts_within
from ..model.errors import KittiRos2Error, some_of
from .object_benchmark import pairs_by_frame, table_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .object_benchmark import ObjectTable
    from .track_metrics import TrackBox


# Errors are in units of what a passable detector or odometry has, so that 1 is agreement.

_LEAST_PAIRS = 15
_IMPROVED = 0.8
"""The least part of the pairs that a row must improve."""
_TIMES_BETTER = 2.0
_NO_ERROR = 0.05


class Change(NamedTuple):
    """Errors before and after a mistake is undone, (P,) each, 1 for what counts as agreement."""

    before: Float64Array
    after: Float64Array

    @property
    def explains(self) -> bool:
        """Whether the mistake was made: results agree without it, and only without it."""
        if len(self.after) < _LEAST_PAIRS:
            return False
        before, after = float(np.median(self.before)), float(np.median(self.after))
        return (
            after <= 1
            and before >= _TIMES_BETTER * max(after, _NO_ERROR)
            and float(np.mean(self.after < self.before)) >= _IMPROVED
        )


def diagnose_detections(
    source: str,
    class_names: Collection[str],
    labels: ObjectTable,
    detections: ObjectTable,
    numbers: Sequence[int],
) -> Iterator[str]:
    """Yield a note for each usual mistake in detections or in their labels.

    Args:
        source: Of the detections, for users.
        class_names: The scored classes, in lower case.
        labels: Labels of the scored frames.
        detections: Detections of the same frames.
        numbers: The numbers of these frames.
    """
    yield from _diagnose_labels(class_names, labels)
    yield from _diagnose_classes(source, class_names, labels, detections)
    yield from _diagnose_scores(source, detections)
    yield from _diagnose_boxes(source, labels, detections)
    yield from _diagnose_frames(source, *_numbered(labels, detections, numbers))


def diagnose_predictions(
    source: str, readers: Sequence[Callable[[int], Any]], numbers: Sequence[int]
) -> Iterator[str]:
    """Yield a note for each usual mistake in the boxes of predictions.

    Args:
        source: Of the predictions, for users.
        readers: Return labels and predictions of a frame, FrameLabels; a frame without either,
            which raises KittiRos2Error or OSError, is left out.
        numbers: The frames.
    """
    frames: list[tuple[list[Box], ...]] = []
    read_numbers = []
    for number in numbers:
        with suppress(KittiRos2Error, OSError):
            both = [read(number).boxes for read in readers]
            frames.append(tuple([box for box in boxes if box is not None] for boxes in both))
            read_numbers.append(number)
    if frames:
        labels, predictions = (table_of(series) for series in zip(*frames, strict=True))
        yield from _diagnose_boxes(source, labels, predictions)
        yield from _diagnose_frames(source, *_numbered(labels, predictions, read_numbers))


def _numbered(
    labels: ObjectTable, detections: ObjectTable, numbers: Sequence[int]
) -> tuple[ObjectTable, ObjectTable]:
    """Return tables with the numbers of their frames."""
    by_index = np.array(numbers, np.int64)
    return replace(labels, frame=by_index[labels.frame]), replace(
        detections, frame=by_index[detections.frame]
    )


# Detections: pairs of a label and the detection that has its place in the image.


@dataclass(frozen=True, eq=False)
class _Solids:
    """The 3D boxes of P objects: size_hwl and location (P, 3), rotation_y (P,), as in KITTI."""

    size_hwl: Float64Array
    location: Float64Array
    rotation_y: Float64Array


_Undo: TypeAlias = 'Callable[[_Solids], _Solids]'
_Compare: TypeAlias = 'Callable[[_Solids, _Solids], Float64Array]'


class _Mistake(NamedTuple):
    """A mistake, and what undoes it.

    Attributes:
        undo: Gives the boxes without it.
        text: The sentence, about {agreeing} of {count} boxes.
    """

    undo: _Undo
    text: str


class _Alternatives(NamedTuple):
    """Mistakes of which results have one at most, and the error that shows them."""

    error: _Compare
    mistakes: Sequence[_Mistake]


_SIZE_LOG = 0.3  # a factor of 1.35
_AXIS_M, _AXIS_PART = 1.0, 0.1  # of the distance, which monocular detectors estimate
_HEIGHT_PART = 0.25  # of the object's height
_YAW = 0.3
_WHOLE_TURN, _LEAST_BEYOND = 2 * np.pi, 0.25


def _size_error(labels: _Solids, boxes: _Solids) -> Float64Array:
    ratios = np.log(np.maximum(boxes.size_hwl, 1e-3) / np.maximum(labels.size_hwl, 1e-3))
    error: Float64Array = np.abs(ratios).max(axis=1) / _SIZE_LOG
    return error


def _place_error(labels: _Solids, boxes: _Solids) -> Float64Array:
    off = np.hypot(*(boxes.location - labels.location)[:, ::2].T)
    error: Float64Array = off / (_AXIS_M + _AXIS_PART * np.hypot(*labels.location[:, ::2].T))
    return error


def _height_error(labels: _Solids, boxes: _Solids) -> Float64Array:
    off = np.abs(boxes.location[:, 1] - labels.location[:, 1])
    error: Float64Array = off / (_HEIGHT_PART * np.maximum(labels.size_hwl[:, 0], 1e-3))
    return error


def _yaw_error(labels: _Solids, boxes: _Solids) -> Float64Array:
    """Return the angles between the boxes' sides: a box that is turned round has the same."""
    error: Float64Array = np.abs(_near_0(boxes.rotation_y - labels.rotation_y, np.pi)) / _YAW
    return error


def _near_0(angles: Float64Array, period: float) -> Float64Array:
    near: Float64Array = (angles + period / 2) % period - period / 2
    return near


def _ordered(order: Sequence[int]) -> _Undo:
    """Return what undoes an order of sizes, given by the index in h w l of each column."""
    columns = [order.index(index) for index in range(3)]
    return lambda boxes: replace(boxes, size_hwl=boxes.size_hwl[:, columns])


def _from_scanner(boxes: _Solids) -> _Solids:
    x, y, z = boxes.location.T
    return replace(boxes, location=np.stack([-y, -z, x], axis=1))


def _from_centre(boxes: _Solids) -> _Solids:
    lower = np.array([0, 0.5, 0]) * boxes.size_hwl[:, :1]
    return replace(boxes, location=boxes.location + lower)


def _turned(yaw: Callable[[Float64Array, _Solids], Float64Array], *, degrees: bool) -> _Undo:
    def undo(boxes: _Solids) -> _Solids:
        angles = boxes.rotation_y
        is_constant = len(np.unique(angles)) < 2  # as of detectors of 2D boxes
        if is_constant or (degrees and np.mean(np.abs(angles) > _WHOLE_TURN) < _LEAST_BEYOND):
            return boxes
        return replace(boxes, rotation_y=yaw(np.radians(angles) if degrees else angles, boxes))

    return undo


_YAWS: dict[str, Callable[[Float64Array, _Solids], Float64Array]] = {
    '': lambda yaw, _: yaw,
    'the yaw of the scanner (counterclockwise from x forward: rotation_y = -yaw - pi/2)': (
        lambda yaw, _: -yaw - np.pi / 2
    ),
    'an angle of the other sign': lambda yaw, _: -yaw,
    'an angle a quarter of a turn off': lambda yaw, _: yaw + np.pi / 2,
    'alpha, the angle of observation (rotation_y = alpha + atan2(x, z))': (
        lambda yaw, boxes: yaw + np.arctan2(boxes.location[:, 0], boxes.location[:, 2])
    ),
}
_ORDERS = [order for order in permutations(range(3)) if order != (0, 1, 2)]
_NAMES = ('height', 'width', 'length')

_BOX_MISTAKES = (
    _Alternatives(
        _size_error,
        [
            _Mistake(
                _ordered(order),
                'sizes of {agreeing} of {count} boxes that match labels in 2D agree with these in'
                f' the order {" ".join(_NAMES[index] for index in order)}; KITTI has height width'
                ' length',
            )
            for order in _ORDERS
        ],
    ),
    _Alternatives(
        _place_error,
        [
            _Mistake(
                _from_scanner,
                'locations of {agreeing} of {count} boxes that match labels in 2D agree with these'
                ' as x forward, y left, z up, the axes of the scanner; KITTI has them in the'
                ' rectified camera 0: x right, y down, z forward',
            )
        ],
    ),
    _Alternatives(
        _height_error,
        [
            _Mistake(
                _from_centre,
                'locations of {agreeing} of {count} boxes that match labels in 2D are half their'
                " height too high: centres of boxes; KITTI has the centre of a box's bottom (add"
                ' height / 2 to y)',
            )
        ],
    ),
    _Alternatives(
        _yaw_error,
        [
            _Mistake(
                _turned(yaw, degrees=degrees),
                'rotation_y of {agreeing} of {count} boxes that match labels in 2D agrees with'
                f' theirs as {name or "an angle"}{" in degrees" if degrees else ""}; KITTI has'
                ' radians about y, 0 along x',
            )
            for degrees, (name, yaw) in product((False, True), _YAWS.items())
            if degrees or name
        ],
    ),
)
"""The mistakes in 3D boxes; each is looked for after those before it are undone."""

_MATCHING_IOU = 0.5


@np.errstate(all='ignore')  # boxes may hold any numbers
def _diagnose_boxes(source: str, labels: ObjectTable, detections: ObjectTable) -> Iterator[str]:
    """Yield a note for each usual mistake in the 3D boxes of detections."""
    label, detection, _ = _match_in_image(labels, detections)
    truth, boxes = _solids(labels, label), _solids(detections, detection)
    for error, mistakes in _BOX_MISTAKES:
        changes = [(_change(error, truth, boxes, row.undo(boxes)), row) for row in mistakes]
        explaining = [pair for pair in changes if pair[0].explains]
        if explaining:
            _, row = min(explaining, key=lambda pair: float(np.median(pair[0].after)))
            boxes = row.undo(boxes)
            agreeing = int(np.count_nonzero(error(truth, boxes) <= 1))
            yield f'{source}: {row.text.format(agreeing=agreeing, count=len(label))}'


def _change(error: _Compare, truth: _Solids, boxes: _Solids, undone: _Solids) -> Change:
    """Return the errors of those boxes that the mistake changes."""
    differ = error(boxes, undone) > 1
    return Change(error(truth, boxes)[differ], error(truth, undone)[differ])


def _match_in_image(
    labels: ObjectTable, detections: ObjectTable, shift: int = 0
) -> tuple[Int64Array, Int64Array, Float64Array]:
    """Return labels, the detections that match them in the image, and their IoU.

    A pair overlaps more than either does with others of its frame, whatever the classes.

    Args:
        labels: The labels; DontCare regions match nothing.
        detections: The detections.
        shift: Frames by which detections are moved to later ones.
    """
    moved = replace(detections, frame=detections.frame + shift)
    parts = [
        (*pairs, ious_2d(labels.box_2d[pairs.label], detections.box_2d[pairs.detection]))
        for pairs in pairs_by_frame(labels, moved)
    ]
    empty = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    label, detection, iou = (np.concatenate(part) for part in zip(empty, *parts, strict=True))
    near = (iou > _MATCHING_IOU) & ~labels.of_classes({DONT_CARE.lower()})[label]
    label, detection, iou = label[near], detection[near], iou[near]
    best_of_label, best_of_detection = np.zeros(len(labels)), np.zeros(len(detections))
    np.maximum.at(best_of_label, label, iou)
    np.maximum.at(best_of_detection, detection, iou)
    mutual = (iou == best_of_label[label]) & (iou == best_of_detection[detection])
    return label[mutual], detection[mutual], iou[mutual]


def _solids(table: ObjectTable, rows: Int64Array) -> _Solids:
    return _Solids(table.size_hwl[rows], table.location[rows], table.rotation_y[rows])


# Detections of other frames, other classes, and other scores.

_SHIFTS = (-1, 1)
_LEAST_MOVED, _MOVED_IOU, _CLOSER = 25, 0.05, 0.85
_FOCAL_PX, _MIDDLE_PX = 721.5, (609.6, 172.9)
"""Of KITTI's first day; those of the others are within 2 %."""
_CONSISTENT, _MATCHING = 0.7, 0.25
_LEAST_OTHER = 30


@np.errstate(all='ignore')  # boxes may hold any numbers
def _diagnose_frames(source: str, labels: ObjectTable, detections: ObjectTable) -> Iterator[str]:
    """Yield a note on detections of other frames than the labels; frames are numbers."""
    ious = {shift: _best_ious(labels, detections, shift) for shift in (0, *_SHIFTS)}
    for shift in _SHIFTS:
        seen = np.maximum(ious[0], ious[shift]) > _MATCHING_IOU
        gains = (ious[shift] - ious[0])[seen]
        gains = gains[np.abs(gains) > _MOVED_IOU]
        if len(gains) >= _LEAST_MOVED and np.mean(gains > 0) >= _CLOSER:
            matching, own = (int(np.count_nonzero(ious[key] > _MATCHING_IOU)) for key in (shift, 0))
            yield (
                f'{source}: {matching} of {len(labels)} labels match detections of the frame'
                f' {"after" if shift < 0 else "before"} theirs in 2D, {own} those of their own:'
                f' results are numbered one too {"high" if shift < 0 else "low"}'
            )
            return
    surest = np.argsort(-detections.score, kind='stable')[: max(len(labels), _LEAST_OTHER)]
    flat = _heights(labels) > 0
    if (
        len(surest) >= _LEAST_OTHER
        and flat.any()
        and np.mean(flat) > _MATCHING
        and _agree_with_image(detections, surest)
    ):
        matching = _matching_any(labels, detections, surest)
        if matching < _MATCHING * len(surest):
            yield (
                f'{source}: {len(surest) - matching} of the {len(surest)} surest detections match'
                ' no label in 2D, though most agree with their own 3D boxes: are these results of'
                ' another split, or numbered otherwise?'
            )


def _best_ious(labels: ObjectTable, detections: ObjectTable, shift: int) -> Float64Array:
    label, _, iou = _match_in_image(labels, detections, shift)
    best = np.zeros(len(labels))
    best[label] = iou
    return best


def _agree_with_image(detections: ObjectTable, rows: Int64Array) -> bool:
    """Return whether 3D boxes have the places of their 2D boxes by KITTI's camera."""
    x, y, z = detections.location[rows].T
    middle_y = y - detections.size_hwl[rows, 0] / 2
    left, top, right, bottom = detections.box_2d[rows].T
    u, v = _MIDDLE_PX[0] + _FOCAL_PX * x / z, _MIDDLE_PX[1] + _FOCAL_PX * middle_y / z
    inside = (u >= left) & (u <= right) & (v >= top) & (v <= bottom) & (z > 0)
    return bool(np.mean(inside) >= _CONSISTENT)


def _matching_any(labels: ObjectTable, detections: ObjectTable, rows: Int64Array) -> int:
    """Count detections that match a label in 2D, or are within a DontCare region."""
    matched = np.zeros(len(detections), np.bool_)
    uncounted = labels.of_classes({DONT_CARE.lower()})
    for label, detection in pairs_by_frame(labels, detections):
        first, second = labels.box_2d[label], detections.box_2d[detection]
        overlap = np.where(uncounted[label], parts_within(second, first), ious_2d(first, second))
        matched[detection[overlap > _MATCHING_IOU]] = True
    return int(np.count_nonzero(matched[rows]))


def _diagnose_classes(
    source: str, class_names: Collection[str], labels: ObjectTable, detections: ObjectTable
) -> Iterator[str]:
    """Yield a note for each class that detections have under another name, or not at all."""
    label, detection, _ = _match_in_image(labels, detections)
    counts = {
        name: int(np.count_nonzero(detections.of_classes({name})))
        for name in detections.class_names
    }
    for class_name in class_names:
        if counts.get(class_name):
            continue
        text = f'{class_name}: {source} has no detection of this class in the scored frames'
        own = labels.of_classes({class_name})[label]
        named = detections.class_index[detection[own]]
        if len(named):
            most = int(np.bincount(named).argmax())
            text += (
                f'; {np.count_nonzero(named == most)} of {len(named)} that match its labels in 2D'
                f' are named {detections.class_names[most]}'
            )
        elif others := [f'{name} ({n})' for name, n in counts.items() if name not in class_names]:
            text += f', but of {some_of(others)}'
        yield text


_PERCENT = 100.0
_LEAST_PERCENT = 10.0


def _diagnose_scores(source: str, detections: ObjectTable) -> Iterator[str]:
    """Yield a note on scores in percent, and on scores that are all equal."""
    scores = detections.score[~detections.of_classes({DONT_CARE.lower()})]
    if len(scores) < _LEAST_PAIRS:
        return
    low, high = float(scores.min()), float(scores.max())
    if low == high:
        yield (
            f'{source}: all {len(scores)} scores are {low:g}; equal scores make a curve of one'
            ' point'
        )
    elif low >= 0 and _LEAST_PERCENT < high <= _PERCENT and np.mean(scores > 1) > _IMPROVED:
        yield (
            f'{source}: scores are {low:g} to {high:g}: percent? average precision is the same, but'
            ' thresholds such as --score are of 0 to 1'
        )


def _diagnose_labels(class_names: Collection[str], labels: ObjectTable) -> Iterator[str]:
    """Yield a note for each class of which the benchmark ignores every label by its height."""
    least = min(limits.height_px for limits in LIMITS.values())
    low = _heights(labels) <= least
    for class_name in class_names:
        own = labels.of_classes({class_name})
        count = int(np.count_nonzero(own))
        if count and low[own].all():
            yield (
                f'{class_name}: all {count} labels have a 2D box lower than'
                f' {least:g} px, or none: the benchmark ignores them, also in bev and 3d; project'
                ' the 3D boxes into the image'
            )


def _heights(table: ObjectTable) -> Float64Array:
    heights: Float64Array = table.box_2d[:, 3] - table.box_2d[:, 1]
    return heights


# Tracks: ids that do not last, boxes without a place in the image, and those of other frames.


@np.errstate(all='ignore')  # boxes may hold any numbers
def diagnose_tracks(
    source: str, labels: Sequence[TrackBox], tracks: Sequence[TrackBox]
) -> Iterator[str]:
    """Yield a note for each usual mistake in the tracks of a sequence.

    Args:
        source: Of the tracks, for users.
        labels: Boxes of its labels.
        tracks: Boxes of its results.
    """
    ordered = sorted(tracks, key=lambda box: box.frame)
    truth, results = _track_table(sorted(labels, key=lambda box: box.frame)), _track_table(ordered)
    for whose, table in (('labels', truth), (source, results)):
        if len(table) >= _LEAST_PAIRS and (_heights(table) <= 0).all():
            yield (
                f'{whose}: none of {len(table)} boxes has a 2D box, which is what tracks are'
                ' scored by; project the 3D boxes into the image'
            )
            return
    yield from _diagnose_frames(source, truth, results)
    ids = np.array([box.track_id for box in ordered], np.int64)
    label, detection, _ = _match_in_image(results, results, shift=1)
    other = np.count_nonzero(ids[label] != ids[detection])
    if len(label) >= _LEAST_PAIRS and other > len(label) / 2:
        yield (
            f'{source}: {other} of {len(label)} boxes at the place of one in the frame before have'
            ' another id: ids that start anew in each frame, or number its boxes?'
        )


def _track_table(boxes: Sequence[TrackBox]) -> ObjectTable:
    table = table_of([[box.box for box in boxes]])
    return replace(table, frame=np.array([box.frame for box in boxes], np.int64))
