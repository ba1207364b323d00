# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's object benchmark: precision over recall of one class, as the devkit computes it.

Source: evaluate_object.cpp of the object devkit (cleanData, computeStatistics, getThresholds,
eval_class). Its rules, in the order of the code:

- A label counts if it is of the class and, at the level of difficulty, not too occluded or
  truncated, and higher than 40, 25 or 25 px: one of exactly that height is ignored. Occlusion and
  truncation may equal their limits.
- Labels of the class that do not count, and those of the neighbour class (Van for Car,
  Person_sitting for Pedestrian), are ignored: they are no misses, and a detection on one of them is
  neither right nor wrong. Labels of other classes do not exist.
- A detection lower than 40, 25 or 25 px is ignored, of whatever class it is: the devkit looks at
  the height first. It may match a label, which is then neither detected nor missed.
- Labels choose among the detections left over by earlier lines of the file. Detections that
  overlap by the limit exactly do not match.
- First all labels choose the detection of the highest score, the first line of equals. The scores
  of those that match a label that counts are sampled at 41 evenly spaced values of recall.
- Then, at each of the sampled scores, only detections of at least that score exist, and labels
  choose the greatest overlap, the first line of equals; an ignored detection only if there is no
  other, and then the first of them.
- A detection that no label takes is a false positive, unless a DontCare region covers more of it
  than the limit, measured by the same kind of box. DontCare regions have no 3D box, so this has
  an effect in the image only.
- Precision at a sample is the maximum of it and those at higher recall. A sample that is not
  reached is 0, also where fewer labels than samples count: a class of 10 labels has 10 samples
  at most, and a perfect detector an R40 of 22.5 %.
- The orientation similarity of a true positive is (1 + cos(difference of alpha)) / 2, that of a
  false positive 0; AOS is its mean over both instead of precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from ..model.boxes import (
    DONT_CARE,
    LIMITS,
    NEIGHBOURS,
    UNKNOWN_OCCLUSION,
    Difficulty,
    shared_areas_2d,
    signed_areas,
)
from ..model.errors import format_count, some_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from ..model.boxes import Box
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .ground_truth import FrameBoxes


SAMPLES = 41
"""Number of samples of recall, 0 to 1."""
_STEP_R11 = 4
_COUNTED, _IGNORED, _OTHER = 0, 1, -1
_LEAST_SCORE = -10_000_000.0
"""NO_DETECTION of the devkit: lower scores match no label in the first pass."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Precision, or orientation similarity, over recall.

    Attributes:
        values: (41,) at recall 0, 1/40, ... 1; each the maximum of it and those at higher recall.
        objects: Number of labels that count.
    """

    values: Float64Array
    objects: int

    @property
    def r40(self) -> float:
        """Average at 40 values of recall, without 0, percent."""
        return 100 * float(self.values[1:].mean())

    @property
    def r11(self) -> float:
        """Average at 11 values of recall, percent."""
        return 100 * float(self.values[::_STEP_R11].mean())

    @property
    def highest_r40(self) -> float:
        """R40 of a perfect detector, percent: below 100 for fewer objects than samples."""
        return 100 * max(min(self.objects, SAMPLES) - 1, 0) / (SAMPLES - 1)


Scores: TypeAlias = 'Mapping[str, Mapping[str, Mapping[Difficulty, Curve | None]]]'
"""By class in lower case, metric (3d, bev, 2d, aos) and level; None where not evaluated."""


class Curves(NamedTuple):
    """The curves of one class at one level of difficulty."""

    precision: Curve
    similarity: Curve


@dataclass(frozen=True, eq=False)
class ClassObjects:
    """The labels and detections that concern a class at a level of difficulty.

    Attributes:
        labels, detections: All objects.
        label_states, detection_states: Counted, ignored or other; int8 by object.
    """

    labels: ObjectTable
    detections: ObjectTable
    label_states: npt.NDArray[np.int8]
    detection_states: npt.NDArray[np.int8]


def select_class(
    labels: ObjectTable, detections: ObjectTable, class_name: str, level: Difficulty
) -> ClassObjects:
    """Select the objects that concern a class (in lower case) at a level of difficulty."""
    limits = LIMITS[level]
    ignored = (
        (labels.occluded > limits.occluded)
        | (labels.truncated > limits.truncated)
        | (labels.box_2d[:, 3] - labels.box_2d[:, 1] <= limits.height_px)
    )
    own = labels.of_classes({class_name})
    neighbours = labels.of_classes(NEIGHBOURS.get(class_name, frozenset()))
    low = np.abs(detections.box_2d[:, 1] - detections.box_2d[:, 3]) < limits.height_px
    return ClassObjects(
        labels,
        detections,
        _states(own & ~ignored, (own & ignored) | neighbours),
        _states(~low & detections.of_classes({class_name}), low),
    )


def _states(counted: BoolArray, ignored: BoolArray) -> npt.NDArray[np.int8]:
    return np.select([counted, ignored], [_COUNTED, _IGNORED], _OTHER).astype(np.int8)


def evaluate_class(objects: ClassObjects, overlaps: Overlaps, limit: float) -> Curves:
    """Return the curves of a class.

    Args:
        objects: The objects that concern it.
        overlaps: Overlaps of all labels and detections, in one space.
        limit: The overlap above which a detection matches.
    """
    label, detection, overlap = (column[overlaps.overlap > limit] for column in overlaps)
    uncounted = objects.labels.of_classes({DONT_CARE.lower()})[label]
    covered = np.zeros(len(objects.detections), np.bool_)
    covered[detection[uncounted]] = True
    states = objects.label_states[label], objects.detection_states[detection]
    concerned = (states[0] != _OTHER) & (states[1] != _OTHER)
    pairs = _Candidates(objects, label[concerned], detection[concerned], overlap[concerned])
    count = int(np.count_nonzero(objects.label_states == _COUNTED))
    thresholds = np.array(sample_scores(pairs.first_scores(), count))
    right, similarity, matched = pairs.match_at(thresholds, covered)
    wrong = _count_from(thresholds, objects, covered) - matched
    precision, orientation = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for curve, share in ((precision, right), (orientation, similarity)):
        positive = np.maximum(right + wrong, 1)  # 0 / 0 is 0
        curve[: len(thresholds)] = share / positive
        np.maximum.accumulate(curve[::-1], out=curve[::-1])
    return Curves(Curve(precision, count), Curve(orientation, count))


def sample_scores(scores: Sequence[float], objects: int) -> list[float]:
    """Return the scores at which recall is nearest to 0, 1/40, ... 1; getThresholds of the devkit.

    Args:
        scores: Scores of the true positives.
        objects: Number of labels that count.
    """
    ordered = sorted(scores, reverse=True)
    sampled: list[float] = []
    recall, last = 0.0, len(ordered) - 1
    for index, score in enumerate(ordered):
        below, above = (index + 1) / objects, (index + 2) / objects
        if index < last and above - recall < recall - below:
            continue
        sampled.append(score)
        recall += 1.0 / (SAMPLES - 1.0)
    return sampled


def _count_from(thresholds: Float64Array, objects: ClassObjects, covered: BoolArray) -> Int64Array:
    """Return (T,) numbers of counted detections of at least a score, out of DontCare regions."""
    scores = np.sort(objects.detections.score[(objects.detection_states == _COUNTED) & ~covered])
    counts: Int64Array = len(scores) - np.searchsorted(scores, thresholds, 'left')
    return counts


class _Candidates:
    """The candidate pairs of a label and a detection, and the choice of labels among them."""

    def __init__(
        self,
        objects: ClassObjects,
        label: Int64Array,
        detection: Int64Array,
        overlap: Float64Array,
    ) -> None:
        self._objects = objects
        self._label, self._detection, self._overlap = label, detection, overlap
        self._score = objects.detections.score[detection]
        self._ignored = objects.detection_states[detection] == _IGNORED
        self._true = (objects.label_states[label] == _COUNTED) & ~self._ignored

    def first_scores(self) -> list[float]:
        """Return the scores of the true positives of the first pass, without a threshold."""
        order = np.lexsort((self._detection, -self._score, self._label))
        matched = self._choose(order, (self._score > _LEAST_SCORE)[:, None])[:, 0]
        scores: list[float] = self._score[matched & self._true].tolist()
        return scores

    def match_at(
        self, thresholds: Float64Array, covered: BoolArray
    ) -> tuple[Int64Array, Float64Array, Int64Array]:
        """Match at each threshold.

        Returns:
            (T,) numbers of true positives, their orientation similarity, and the numbers of counted
            detections out of DontCare regions that a label takes.
        """
        preference = np.where(self._ignored, 0.0, -self._overlap)
        order = np.lexsort((self._detection, preference, self._ignored, self._label))
        matched = self._choose(order, self._score[:, None] >= thresholds)
        delta = (
            self._objects.labels.alpha[self._label]
            - self._objects.detections.alpha[self._detection]
        )
        similarity = (1.0 + np.cos(delta[self._true])) / 2.0
        right = matched[self._true]
        counted = matched[~self._ignored & ~covered[self._detection]].sum(axis=0)
        return right.sum(axis=0), similarity @ right, counted

    def _choose(self, order: Int64Array, exists: BoolArray) -> BoolArray:
        """Match each label to its first free pair; return (P, T) the matched pairs.

        The n-th pairs of all frames are done at once: they have no label or detection in common.

        Args:
            order: (P,) the pairs label by label, the preferred ones first.
            exists: (P, T) which pairs exist at each threshold.
        """
        matched = np.zeros(exists.shape, np.bool_)
        label_free, label = _all_free(self._label, exists.shape[1])
        detection_free, detection = _all_free(self._detection, exists.shape[1])
        for rows in _nth_of_each(self._objects.labels.frame[self._label[order]]):
            pairs = order[rows]
            chosen = exists[pairs] & label_free[label[pairs]] & detection_free[detection[pairs]]
            matched[pairs] = chosen
            label_free[label[pairs]] &= ~chosen
            detection_free[detection[pairs]] &= ~chosen
        return matched


def _all_free(indices: Int64Array, columns: int) -> tuple[BoolArray, Int64Array]:
    """Return a row of True for each object that occurs, and by pair the row of its object."""
    different, rows = np.unique(indices, return_inverse=True)
    return np.ones((len(different), columns), np.bool_), rows


def _nth_of_each(groups: Int64Array) -> list[Int64Array]:
    """Return the indices of the first of each group, of the second, ...; groups are ascending."""
    if not len(groups):
        return []
    starts = np.flatnonzero(np.r_[True, groups[1:] != groups[:-1]])
    rank = np.arange(len(groups)) - np.repeat(starts, np.diff(np.r_[starts, len(groups)]))
    order = np.argsort(rank, kind='stable')
    return np.split(order, np.cumsum(np.bincount(rank))[:-1])


# The objects of many frames as columns, and the pairs of objects of the same frame.

BoolArray: TypeAlias = npt.NDArray[np.bool_]

UNSCORED = 1.0
"""The score of a detection without one."""

_NUMBERS = 15
_MOST_PAIRS = 400_000
"""Compared at once: their columns take some 100 MB."""


@dataclass(frozen=True, eq=False)
class ObjectTable:
    """The objects of a series of frames, in the order of the frames and of the lines of each.

    Attributes:
        frame: (N,) index of the frame in the series, ascending.
        class_names: The different class names, in lower case: the devkit compares them by
            strcasecmp.
        class_index: (N,) index of the class name.
        box_2d: (N, 4) left, top, right, bottom, pixels.
        size_hwl: (N, 3) height, width, length, metres.
        location: (N, 3) bottom face's centre in the rectified camera 0 frame, metres.
        rotation_y, alpha: (N,) radians.
        truncated, occluded: (N,) as in Box.
        score: (N,) detection score; 1 for objects without one.
    """

    frame: Int64Array
    class_names: Sequence[str]
    class_index: Int64Array
    box_2d: Float64Array
    size_hwl: Float64Array
    location: Float64Array
    rotation_y: Float64Array
    alpha: Float64Array
    truncated: Float64Array
    occluded: Float64Array
    score: Float64Array

    def __len__(self) -> int:
        return len(self.frame)

    def of_classes(self, class_names: Collection[str]) -> BoolArray:
        """Return (N,) whether each object is of one of some classes, in lower case."""
        indices = [index for index, name in enumerate(self.class_names) if name in class_names]
        return np.isin(self.class_index, indices)


def table_of(frames: Sequence[Sequence[Box]]) -> ObjectTable:
    """Return the objects of a series of frames as columns."""
    boxes = [box for frame in frames for box in frame]
    rows = (
        (
            *box.box_2d,
            *box.size_hwl,
            *box.location,
            box.rotation_y,
            box.alpha,
            box.truncated,
            box.occluded,
            UNSCORED if box.score is None else box.score,
        )
        for box in boxes
    )
    indices: dict[str, int] = {}
    class_index = np.array(
        [indices.setdefault(box.class_name.lower(), len(indices)) for box in boxes], np.int64
    )
    count = _NUMBERS * len(boxes)
    columns = np.fromiter(chain.from_iterable(rows), np.float64, count).reshape(-1, _NUMBERS)
    return ObjectTable(
        np.repeat(np.arange(len(frames), dtype=np.int64), [len(frame) for frame in frames]),
        [*indices],
        class_index,
        columns[:, :4],
        columns[:, 4:7],
        columns[:, 7:10],
        *columns[:, 10:].T,
    )


class Pairs(NamedTuple):
    """Pairs of a label and a detection of the same frame, by label, then by detection.

    Attributes:
        label: (P,) index in the table of ground truth.
        detection: (P,) index in the table of results.
    """

    label: Int64Array
    detection: Int64Array


def pairs_by_frame(
    labels: ObjectTable, detections: ObjectTable, most: int = _MOST_PAIRS
) -> Iterator[Pairs]:
    """Yield all pairs of the same frame, about so many at once; one label's are not divided."""
    first = np.searchsorted(detections.frame, labels.frame, 'left')
    count = np.searchsorted(detections.frame, labels.frame, 'right') - first
    ends = np.cumsum(count)
    start = 0
    while start < len(labels):
        done = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, done + most, 'right')), start + 1)
        label = np.repeat(np.arange(start, stop), count[start:stop])
        offset = np.arange(len(label)) - np.repeat(
            ends[start:stop] - count[start:stop] - done, count[start:stop]
        )
        yield Pairs(label, first[label] + offset)
        start = stop


# Overlaps of many pairs of boxes at once: in the image, on the ground, in space.
#
# Source: imageBoxOverlap, groundBoxOverlap and box3DOverlap in evaluate_object.cpp of the object
# devkit, in float64 as there. A box on the ground is the rectangle length by width, turned by
# rotation_y about the location in x and z of camera 0; a box in space has it between y - height and
# y. The tilt of the camera against the ground is neglected.


class Space(str, Enum):
    """The boxes that are compared."""

    IMAGE = '2d'
    GROUND = 'bev'
    SOLID = '3d'


class Overlaps(NamedTuple):
    """Pairs that overlap by more than a limit, by label, then by detection.

    Attributes:
        label, detection: (P,) indices, as in Pairs.
        overlap: (P,) intersection over union; with a DontCare region the intersection over the
            area (volume) of the detection.
    """

    label: Int64Array
    detection: Int64Array
    overlap: Float64Array


class _Areas(NamedTuple):
    """(P,) areas or volumes of labels, of detections, and of their intersections."""

    label: Float64Array
    detection: Float64Array
    common: Float64Array


@np.errstate(all='ignore')  # empty boxes, and numbers of any size
def find_overlaps(
    labels: ObjectTable, detections: ObjectTable, above: float
) -> Mapping[Space, Overlaps]:
    """Return the pairs of the same frame that overlap by more than a limit, in each space."""
    uncounted = labels.of_classes({DONT_CARE.lower()})
    chunks: dict[Space, list[Overlaps]] = {space: [] for space in Space}
    for pairs in pairs_by_frame(labels, detections):
        for space, shares in _shares(labels, detections, pairs).items():
            union = shares.detection + shares.label - shares.common
            overlap = shares.common / np.where(uncounted[pairs.label], shares.detection, union)
            mask = overlap > above
            chunks[space].append(Overlaps(pairs.label[mask], pairs.detection[mask], overlap[mask]))
    return {space: _joined(overlaps) for space, overlaps in chunks.items()}


def _joined(parts: list[Overlaps]) -> Overlaps:
    if not parts:
        return Overlaps(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    return Overlaps(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _shares(labels: ObjectTable, detections: ObjectTable, pairs: Pairs) -> Mapping[Space, _Areas]:
    first, second = labels.box_2d[pairs.label], detections.box_2d[pairs.detection]
    ground = _ground_shares(labels, detections, pairs)
    heights = labels.size_hwl[pairs.label, 0], detections.size_hwl[pairs.detection, 0]
    bottoms = labels.location[pairs.label, 1], detections.location[pairs.detection, 1]
    common_height = np.minimum(*bottoms) - np.maximum(
        bottoms[0] - heights[0], bottoms[1] - heights[1]
    )
    return {
        Space.IMAGE: _Areas(
            _area(first[:, 2:] - first[:, :2]),
            _area(second[:, 2:] - second[:, :2]),
            shared_areas_2d(first, second),
        ),
        Space.GROUND: ground,
        Space.SOLID: _Areas(
            heights[0] * ground.label,
            heights[1] * ground.detection,
            ground.common * np.maximum(common_height, 0.0),
        ),
    }


def _area(sides: Float64Array) -> Float64Array:
    area: Float64Array = sides[:, 0] * sides[:, 1]
    return area


def _ground_shares(labels: ObjectTable, detections: ObjectTable, pairs: Pairs) -> _Areas:
    """Return the areas on the ground; far pairs have no intersection."""
    first, second = _footprints(labels), _footprints(detections)
    reach = [np.hypot(footprints[:, 2], footprints[:, 3]) / 2 for footprints in (first, second)]
    apart = first[pairs.label, :2] - second[pairs.detection, :2]
    near = np.flatnonzero(np.hypot(*apart.T) < reach[0][pairs.label] + reach[1][pairs.detection])
    common = np.zeros(len(pairs.label))
    common[near] = intersect_rectangles(first[pairs.label[near]], second[pairs.detection[near]])
    areas = [np.abs(_area(footprints[:, 2:4])) for footprints in (first, second)]
    return _Areas(areas[0][pairs.label], areas[1][pairs.detection], common)


def _footprints(table: ObjectTable) -> Float64Array:
    """Return (N, 5) x, z, length, width and rotation_y."""
    columns = (table.location[:, ::2], table.size_hwl[:, :0:-1], table.rotation_y[:, None])
    return np.concatenate(columns, axis=1)


def intersect_rectangles(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (P,) areas that pairs of turned rectangles have in common.

    Args:
        first: (P, 5) x, z, length, width, metres; angle from x towards -z, radians.
        second: The same.
    """
    half = np.abs(first[:, 2:4]).T / 2
    return np.maximum(signed_areas(half, _corners_in(first, second)), 0.0)


def _corners_in(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (2, 4, P) corners of the second rectangles in the frames of the first ones.

    They go round clockwise, with u to the right and v up.
    """
    (x, z), turn = (second[:, :2] - first[:, :2]).T, second[:, 4] - first[:, 4]
    cos, sin = np.cos(first[:, 4]), np.sin(first[:, 4])
    along = np.array([1.0, 1.0, -1.0, -1.0])[:, None] * np.abs(second[:, 2]) / 2
    across = np.array([1.0, -1.0, -1.0, 1.0])[:, None] * np.abs(second[:, 3]) / 2
    u = cos * x - sin * z + np.cos(turn) * along + np.sin(turn) * across
    v = sin * x + cos * z - np.sin(turn) * along + np.cos(turn) * across
    return np.array([u, v])


# Notes on unusual figures, each with its reason in the benchmark's rules.

_MOST_CELLS = 4
_NO_SIZE = -1.0


def left_out_note(count: int, total: int) -> tuple[str, ...]:
    """Return the note on labels of the scored classes whose occlusion is unknown, of so many."""
    if not count:
        return ()
    part = f'{count} of {format_count(total, "label")}'
    return (f'{part} left out: occlusion {UNKNOWN_OCCLUSION}, unknown; 0 counts as visible',)


def notes_on(
    scores: Scores, results: FrameBoxes, labels: ObjectTable, detections: ObjectTable
) -> Iterator[str]:
    """Yield notes on the scores of some results."""
    unknown = labels.occluded[labels.of_classes({*scores})] == UNKNOWN_OCCLUSION
    yield from left_out_note(int(np.count_nonzero(unknown)), len(unknown))
    unscored = sum(box.score is None for boxes in results.boxes.values() for box in boxes)
    if unscored:
        yield (
            f'{results.source}: {unscored} detections without a score, the 16th column, count as'
            f' {UNSCORED:g}; equal scores make a curve of one point'
        )
    yield from _invalid_boxes(results, detections)
    for class_name, metrics in scores.items():
        yield from _notes_on_class(class_name, detections)
        absent = [name for name, levels in metrics.items() if None in levels.values()]
        if absent:
            yield (
                f'{class_name}: {", ".join(absent)} not evaluated, as in the devkit: no detection'
                f' of the class has such a box, or, for aos, a detection has alpha -10'
            )
    few = dict.fromkeys(
        f'{class_name} {level.value} {curve.objects} (at most {curve.highest_r40:.2f})'
        for class_name, metrics in scores.items()
        for level in Difficulty
        for curve in (levels[level] for levels in metrics.values())
        if curve is not None and 0 < curve.objects < SAMPLES
    )
    if few:
        yield (
            f'fewer objects than the {SAMPLES} samples of recall, so that no detector reaches an'
            f' R40 of 100: {some_of([*few], _MOST_CELLS)}'
        )


def _invalid_boxes(results: FrameBoxes, detections: ObjectTable) -> Iterator[str]:
    """Yield notes on invalid boxes, which match no label."""
    left, top, right, bottom = detections.box_2d.T
    sizes = detections.size_hwl
    counts = {
        '2D box whose right is left of its left edge, or its bottom above its top': (
            (right < left) | (bottom < top)
        ),
        'height, width or length below 0': ((sizes < 0) & (sizes != _NO_SIZE)).any(axis=1),
    }
    for fault, invalid in counts.items():
        count = int(np.count_nonzero(invalid))
        if count:
            yield f'{results.source}: {format_count(count, "detection")} with a {fault}'


def _notes_on_class(class_name: str, detections: ObjectTable) -> Iterator[str]:
    own = detections.of_classes({class_name})
    least = min(limits.height_px for limits in LIMITS.values())
    low = np.abs(detections.box_2d[own, 3] - detections.box_2d[own, 1]) < least
    if own.any() and low.all():
        yield (
            f'{class_name}: all detections have a 2D box lower than {least:g} px, or none: the'
            f' benchmark ignores them, also in bev and 3d; project the 3D boxes into the image'
        )
