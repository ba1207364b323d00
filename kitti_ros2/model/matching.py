# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overlap of boxes, and which predictions find which labels, by the rules of KITTI's devkit.

Source: evaluate_object.cpp of the object devkit. A prediction is a true positive (TP) if its
intersection over union (IoU) with a label of its class is above 0.7 for cars and 0.5 for
pedestrians and cyclists, or above a chosen one; another is a false positive (FP), and a label that
none finds a false negative (FN). Not counted are predictions on a label of a neighbouring class (a
car on a van, a pedestrian on a person sitting) or within a DontCare region, and labels of classes
that KITTI does not evaluate. Classes are compared without regard to case.

Other than there, predictions choose by descending score, classes that KITTI does not evaluate count
when they are predicted, and neither size nor occlusion makes a label too hard to count.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .boxes import DONT_CARE, cuboid_corners
from .geometry import cut_polygon_by
from .least_overlaps import KITTI_OVERLAPS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .boxes import Cuboid
    from .geometry import Float64Array
    from .least_overlaps import LeastOverlaps

NEIGHBOURS = {
    'car': frozenset({'van'}),
    'pedestrian': frozenset({'person_sitting', 'person (sitting)'}),
}
"""A class that KITTI evaluates, and those that look like it, in lower case."""

_DONT_CARE = DONT_CARE.lower()
_UNEVALUATED = frozenset(
    {'van', 'truck', 'tram', 'person_sitting', 'person (sitting)', 'misc', _DONT_CARE}
)


class Matchable(Protocol):
    """An object with boxes, a label or a prediction."""

    @property
    def class_name(self) -> str:
        """Class name."""

    @property
    def cuboid(self) -> Cuboid | None:
        """3D box in velo_link, None without one."""

    @property
    def box_2d(self) -> tuple[float, float, float, float] | None:
        """left, top, right, bottom, pixels, None without one."""

    @property
    def score(self) -> float | None:
        """Detection score, None for ground truth."""


class Verdict(str, Enum):
    """The result of a comparison of predictions with labels, for one of them."""

    TRUE_POSITIVE = 'TP'
    FALSE_POSITIVE = 'FP'
    FALSE_NEGATIVE = 'FN'


class Match(NamedTuple):
    """The comparison of one prediction with the labels of a frame, or of one label.

    Attributes:
        verdict: None for one that does not count.
        partner: The index of the label that a prediction finds, or of the prediction that finds a
            label; None without one.
        overlap: IoU with the partner; without one, the greatest with any label of the class.
    """

    verdict: Verdict | None
    partner: int | None = None
    overlap: float = 0.0


class Matches(NamedTuple):
    """A match for each label and for each prediction, in their order."""

    labels: Sequence[Match]
    predictions: Sequence[Match]


def match(
    labels: Sequence[Matchable],
    predictions: Sequence[Matchable],
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
) -> Matches:
    """Compare the predictions of a frame with its labels.

    Args:
        labels: Ground truth, with its DontCare regions.
        predictions: Of any classes; one without a score is the surest.
        overlaps: The IoU above which a prediction finds a label.
    """
    predicted = {each.class_name.lower() for each in predictions}
    of_labels = [
        Match(None if _is_uncounted(each.class_name.lower(), predicted) else Verdict.FALSE_NEGATIVE)
        for each in labels
    ]
    of_predictions = [Match(Verdict.FALSE_POSITIVE)] * len(predictions)
    for place in sorted(range(len(predictions)), key=lambda place: -_sureness(predictions[place])):
        prediction = predictions[place]
        found = _match_one(prediction, labels, of_labels, overlaps.of(prediction.class_name))
        of_predictions[place] = found
        if found.partner is not None:
            of_labels[found.partner] = found._replace(partner=place)
    return Matches(of_labels, of_predictions)


def _match_one(
    prediction: Matchable, labels: Sequence[Matchable], taken: Sequence[Match], least: float
) -> Match:
    """Return the match of a prediction with the labels that are not taken yet."""
    best = 0.0
    class_name = prediction.class_name.lower()
    classes = frozenset({class_name}), NEIGHBOURS.get(class_name, frozenset())
    for verdict, chosen in zip((Verdict.TRUE_POSITIVE, None), classes, strict=True):
        overlaps = {
            place: overlap_of(prediction, each)
            for place, each in enumerate(labels)
            if each.class_name.lower() in chosen
        }
        if verdict is Verdict.TRUE_POSITIVE:
            best = max(overlaps.values(), default=0.0)
        free = [
            (overlap, -place)
            for place, overlap in overlaps.items()
            if overlap > least and taken[place].partner is None
        ]
        if free:
            overlap, place = max(free)
            return Match(verdict, -place, overlap)
    regions = (each for each in labels if each.class_name.lower() == _DONT_CARE)
    ignored = any(_share_within(prediction, region) > least for region in regions)
    return Match(None if ignored else Verdict.FALSE_POSITIVE, overlap=best)


def overlap_of(one: Matchable, other: Matchable) -> float:
    """Return the IoU of the 3D boxes if both objects have one, else of the 2D boxes, else 0."""
    if one.cuboid is not None and other.cuboid is not None:
        return iou_3d(one.cuboid, other.cuboid)
    if one.box_2d is not None and other.box_2d is not None:
        return iou_2d(one.box_2d, other.box_2d)
    return 0.0


def iou_2d(
    one: tuple[float, float, float, float], other: tuple[float, float, float, float]
) -> float:
    """Return the intersection over union of two rectangles left, top, right, bottom."""
    shared = _shared_area(one, other)
    return _ratio(shared, _shared_area(one, one) + _shared_area(other, other) - shared)


@np.errstate(all='ignore')  # labels may hold any numbers
def iou_3d(one: Cuboid, other: Cuboid) -> float:
    """Return the intersection over union of two boxes that stand on one plane.

    Boxes that are tilted against each other are compared upright, as seen along the first one's
    vertical axis.
    """
    reach = (math.hypot(*one.size_lwh) + math.hypot(*other.size_lwh)) / 2
    if not math.dist(one.velo_T_box.translation, other.velo_T_box.translation) <= reach:
        return 0.0
    shared = intersection_area(one, other) * _shared_height(one, other)
    return _ratio(shared, math.prod(one.size_lwh) + math.prod(other.size_lwh) - shared)


def intersection_area(one: Cuboid, other: Cuboid) -> float:
    """Return the area that the footprints of two boxes share, square metres."""
    half = np.array(one.size_lwh[:2]) / 2
    corners = one.velo_T_box.inverse().apply(cuboid_corners([other])[0, :4])[:, :2]
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            corners = cut_polygon_by(corners, half[axis] - sign * corners[:, axis])
    return _area(corners)


def _shared_height(one: Cuboid, other: Cuboid) -> float:
    """Return the length along the first box's vertical axis that is in both, metres."""
    up = one.velo_T_box.rotation[:, 2]
    middle = float(up @ (other.velo_T_box.translation - one.velo_T_box.translation))
    mine, its = one.size_lwh[2] / 2, other.size_lwh[2] / 2
    return max(min(mine, middle + its) - max(-mine, middle - its), 0.0)


def _area(corners: Float64Array) -> float:
    """Return the area of a (V, 2) polygon, by the shoelace formula."""
    following = np.concatenate([corners[1:], corners[:1]])
    return abs(float(corners[:, 0] @ following[:, 1] - corners[:, 1] @ following[:, 0])) / 2


def _shared_area(
    one: tuple[float, float, float, float], other: tuple[float, float, float, float]
) -> float:
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    return max(width, 0.0) * max(height, 0.0)


def _share_within(prediction: Matchable, region: Matchable) -> float:
    """Return the part of a prediction's 2D box that is within a region, 0..1."""
    if prediction.box_2d is None or region.box_2d is None:
        return 0.0
    box = prediction.box_2d
    return _ratio(_shared_area(box, region.box_2d), _shared_area(box, box))


def _ratio(part: float, whole: float) -> float:
    """Return part / whole; 0 for empty boxes and for numbers that are not finite."""
    return part / whole if 0 < whole < math.inf and math.isfinite(part) else 0.0


def _sureness(prediction: Matchable) -> float:
    score = prediction.score
    return math.inf if score is None else score if math.isfinite(score) else -math.inf


def _is_uncounted(class_name: str, predicted: set[str]) -> bool:
    return class_name == _DONT_CARE or (class_name in _UNEVALUATED and class_name not in predicted)
