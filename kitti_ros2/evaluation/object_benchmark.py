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
  the height first. It may take a label, which is then neither found nor missed.
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
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from ..model.boxes import DONT_CARE
from ..model.difficulty import LIMITS
from ..model.matching import NEIGHBOURS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model.difficulty import Difficulty
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .object_table import BoolArray, ObjectTable
    from .overlap import Overlaps

SAMPLES = 41
"""Of recall, 0 to 1."""
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
        overlaps: Of all labels and detections, in one space.
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
    right, similarity, taken = pairs.match_at(thresholds, covered)
    wrong = _count_from(thresholds, objects, covered) - taken
    precision, orientation = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for curve, share in ((precision, right), (orientation, similarity)):
        positive = np.maximum(right + wrong, 1)  # 0 / 0 is 0
        curve[: len(thresholds)] = share / positive
        np.maximum.accumulate(curve[::-1], out=curve[::-1])
    return Curves(Curve(precision, count), Curve(orientation, count))


def sample_scores(scores: Sequence[float], objects: int) -> list[float]:
    """Return the scores at which recall is nearest to 0, 1/40, ... 1; getThresholds of the devkit.

    Args:
        scores: Of the true positives.
        objects: Number of labels that count.
    """
    ordered = sorted(scores, reverse=True)
    sampled: list[float] = []
    recall, last = 0.0, len(ordered) - 1
    for place, score in enumerate(ordered):
        below, above = (place + 1) / objects, (place + 2) / objects
        if place < last and above - recall < recall - below:
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
    """The pairs of a label and a detection that match, and how labels choose among them."""

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
        taken = matched[~self._ignored & ~covered[self._detection]].sum(axis=0)
        return right.sum(axis=0), similarity @ right, taken

    def _choose(self, order: Int64Array, exists: BoolArray) -> BoolArray:
        """Let each label take its first free pair; return (P, T) which pairs are taken.

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
            found = exists[pairs] & label_free[label[pairs]] & detection_free[detection[pairs]]
            matched[pairs] = found
            label_free[label[pairs]] &= ~found
            detection_free[detection[pairs]] &= ~found
        return matched


def _all_free(indices: Int64Array, columns: int) -> tuple[BoolArray, Int64Array]:
    """Return a row of True for each object that occurs, and by pair the row of its object."""
    different, rows = np.unique(indices, return_inverse=True)
    return np.ones((len(different), columns), np.bool_), rows


def _nth_of_each(groups: Int64Array) -> list[Int64Array]:
    """Return the places of the first of each group, of the second, ...; groups are ascending."""
    if not len(groups):
        return []
    starts = np.flatnonzero(np.r_[True, groups[1:] != groups[:-1]])
    rank = np.arange(len(groups)) - np.repeat(starts, np.diff(np.r_[starts, len(groups)]))
    order = np.argsort(rank, kind='stable')
    return np.split(order, np.cumsum(np.bincount(rank))[:-1])
