# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""3D boxes: values and vectorised geometry, overlaps, and which predictions find which labels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from math import atan2, cos, sin
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from .classes import KITTI_OVERLAPS
from .geometry import Float64Array, Transform

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .classes import LeastOverlaps


# 3D boxes: values and vectorised geometry.
#
# A box has the form of KITTI's labels (source: readme.txt of the object devkit): the bottom
# face's centre in the rectified camera 0 frame (x right, y down, z forward), height, width, length,
# and rotation_y, the heading about y, 0 along +x. Its own frame has its origin in the box's middle,
# x along the heading, y to its left, z up.
#
# Corner order, (8, 3): the bottom face first, then the top face; each from front left, front right,
# rear right to rear left, seen in the box's own frame. Corner i + 4 is above corner i.

OCCLUSIONS = ('visible', 'partly occluded', 'largely occluded', 'unknown')
"""Indexed by the number in a label file (readme.txt of the object devkit)."""

VISIBLE, UNKNOWN_OCCLUSION = 0, 3
"""Evaluations count labels with the first, and leave out those with the other."""

DONT_CARE = 'DontCare'
"""The class of image regions without labels, which have a 2D box only."""


@dataclass(frozen=True)
class Box:
    """One labelled object, as the KITTI object devkit's readme.txt defines it.

    Attributes:
        class_name: Custom names are legal.
        truncated: 0..1, or -1.
        occluded: 0 visible, 1 partly, 2 largely, 3 unknown, or -1.
        alpha: Observation angle, radians.
        box_2d: left, top, right, bottom, pixels of the image, 0-based.
        size_hwl: Height, width, length, metres; (-1, -1, -1) where there is no 3D box.
        location: Bottom face's centre x, y, z in the rectified camera 0 frame, metres.
        rotation_y: Heading about camera y, radians; 0 along +x.
        score: Detection score, None for ground truth.
        frame: File number, tracking only.
        track_id: Identity across frames, tracking only; -1 for DontCare.
    """

    class_name: str
    truncated: float
    occluded: int
    alpha: float
    box_2d: tuple[float, float, float, float]
    size_hwl: tuple[float, float, float]
    location: tuple[float, float, float]
    rotation_y: float
    score: float | None = None
    frame: int | None = None
    track_id: int | None = None


@dataclass(frozen=True, eq=False)
class Cuboid:
    """A box in ROS conventions.

    Attributes:
        class_name: Class, such as Car.
        identity: Unique in its frame: track id, or index in the file.
        velo_T_box: Its own frame (middle, x along the heading, y left, z up) in velo_link.
        size_lwh: Length, width, height along x, y, z, metres.
        score: Detection score, None for ground truth.
        track_id: Identity across frames, None where there is none.
        occluded: As in Box; None if it is not known.
        truncation: Level of the tracking benchmark, 0 to 2; None if it is not known.
    """

    class_name: str
    identity: str
    velo_T_box: Transform
    size_lwh: tuple[float, float, float]
    score: float | None = None
    track_id: int | None = None
    occluded: int | None = None
    truncation: int | None = None


_SIGNS = np.array(
    [
        (1, 1, -1),
        (1, -1, -1),
        (-1, -1, -1),
        (-1, 1, -1),
        (1, 1, 1),
        (1, -1, 1),
        (-1, -1, 1),
        (-1, 1, 1),
    ],
    dtype=np.float64,
)

EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)
"""(12, 2) corners that an edge joins."""

NEAR_M = 0.1
"""The depth at which a box that reaches behind the camera is cut before projection."""


def wrap_angle(angle: npt.ArrayLike) -> Float64Array:
    """Wrap angles in radians to [-pi, pi]."""
    return (np.asarray(angle, np.float64) + np.pi) % (2 * np.pi) - np.pi


def unit_corners() -> Float64Array:
    """Return the (8, 3) corners of the unit cube in its own frame, in the order given above."""
    return _SIGNS / 2


def cuboid_corners(cuboids: Sequence[Cuboid]) -> Float64Array:
    """Return the (N, 8, 3) corners of cuboids in velo_link, metres."""
    rotations = np.array([cuboid.velo_T_box.rotation for cuboid in cuboids]).reshape(-1, 3, 3)
    middles = np.array([cuboid.velo_T_box.translation for cuboid in cuboids]).reshape(-1, 1, 3)
    sizes = np.array([cuboid.size_lwh for cuboid in cuboids], np.float64).reshape(-1, 1, 3)
    corners: Float64Array = (_SIGNS / 2 * sizes) @ np.swapaxes(rotations, 1, 2) + middles
    return corners


def box_rotations(rotation_y: npt.ArrayLike) -> Float64Array:
    """Return (N, 3, 3) rect_R_box: columns are forward, left and up in the camera's frame."""
    angle = np.atleast_1d(np.asarray(rotation_y, np.float64))
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [[c, s, zero], [zero, zero, -one], [-s, c, zero]]
    return np.moveaxis(np.array(rows), -1, 0)


def box_corners(
    location: npt.ArrayLike, size_hwl: npt.ArrayLike, rotation_y: npt.ArrayLike
) -> Float64Array:
    """Return the (N, 8, 3) corners of (N, 3) locations, (N, 3) sizes and (N,) headings."""
    size = np.atleast_2d(np.asarray(size_hwl, np.float64))
    half_lwh = size[:, ::-1] / 2
    middle = np.atleast_2d(np.asarray(location, np.float64)) - [0.0, 1.0, 0.0] * half_lwh[:, 2:]
    offsets = _SIGNS * half_lwh[:, None, :]
    corners: Float64Array = middle[:, None, :] + offsets @ np.swapaxes(
        box_rotations(rotation_y), 1, 2
    )
    return corners


def alpha_of(location: npt.ArrayLike, rotation_y: npt.ArrayLike) -> Float64Array:
    """Return (N,) observation angles: headings relative to the ray to the box, in [-pi, pi)."""
    xyz = np.atleast_2d(np.asarray(location, np.float64))
    return wrap_angle(np.asarray(rotation_y) - np.arctan2(xyz[:, 0], xyz[:, 2]))


def project_corners(corners: Float64Array, p_rect: Float64Array) -> Float64Array:
    """Return (N, 4) left, top, right, bottom of the corners' projection, not clipped to the image.

    A box that reaches behind the camera is cut just in front of it; NaN for one wholly behind.

    Args:
        corners: (N, 8, 3) in the frame that p_rect projects from.
        p_rect: (3, 4).
    """
    seen = corners @ p_rect[:, :3].T + p_rect[:, 3]
    start, end = seen[:, EDGES[:, 0]], seen[:, EDGES[:, 1]]
    crossing = (start[..., 2] < NEAR_M) != (end[..., 2] < NEAR_M)
    depth = np.where(crossing, end[..., 2] - start[..., 2], 1.0)
    cut = start + ((NEAR_M - start[..., 2]) / depth)[..., None] * (end - start)
    points = np.concatenate([seen, cut], axis=1)
    valid = np.concatenate([seen[..., 2] >= NEAR_M, crossing], axis=1)
    pixels = points[..., :2] / np.where(valid, points[..., 2], 1.0)[..., None]
    low = np.where(valid[..., None], pixels, np.inf).min(axis=1)
    high = np.where(valid[..., None], pixels, -np.inf).max(axis=1)
    bounds = np.concatenate([low, high], axis=1)
    bounds[~valid.any(axis=1)] = np.nan
    return bounds


def clip_bounds(bounds: Float64Array, size: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    """Clip bounds to the image, and return the clipped fraction of each.

    Args:
        bounds: (N, 4) left, top, right, bottom, pixels.
        size: (width, height) of the image.

    Returns:
        (N, 4) bounds within 0..width-1 and 0..height-1, NaN for a box out of view; (N,) truncation,
        0 for a box wholly in the image, 1 for one out of view.
    """
    limits = np.array([size[0] - 1, size[1] - 1] * 2, dtype=np.float64)
    cut = np.clip(bounds, 0.0, limits)
    whole = (bounds[:, 2] - bounds[:, 0]) * (bounds[:, 3] - bounds[:, 1])
    left_over = (cut[:, 2] - cut[:, 0]) * (cut[:, 3] - cut[:, 1])
    with np.errstate(invalid='ignore', divide='ignore'):
        truncation = np.clip(1.0 - left_over / whole, 0.0, 1.0)
    unseen = ~(left_over > 0)
    truncation[unseen] = 1.0
    return np.where(unseen[:, None], np.nan, cut), truncation


@np.errstate(over='ignore', invalid='ignore')  # scans and labels may hold any numbers
def count_points(cuboids: Sequence[Cuboid], points: npt.NDArray[np.float32]) -> list[int]:
    """Count the points of a scan inside each box, faces included.

    Args:
        cuboids: In velo_link.
        points: (N, 3) or (N, 4) x y z in velo_link, metres.
    """
    x, y = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    counts = []
    for cuboid in cuboids:
        middle, half = cuboid.velo_T_box.translation, np.array(cuboid.size_lwh) / 2
        reach = np.linalg.norm(half)
        near = np.flatnonzero((np.abs(x - middle[0]) <= reach) & (np.abs(y - middle[1]) <= reach))
        offsets = cuboid.velo_T_box.inverse().apply(points[near, :3])
        counts.append(int(np.count_nonzero((np.abs(offsets) <= half).all(axis=1))))
    return counts


def is_absurd(box: Box) -> bool:
    """Return whether a box has a 3D size that is invalid."""
    return has_cuboid(box) and min(box.size_hwl) <= 0


def has_cuboid(box: Box) -> bool:
    """Return whether a label has a 3D box; DontCare and 2D detections have -1 for every size."""
    return box.class_name != DONT_CARE and box.size_hwl != (-1.0, -1.0, -1.0)


def cuboid_of(box: Box, identity: str, rect_T_velo: Transform) -> Cuboid:
    """Convert a label's box to velo_link with its full rotation: the same points stay inside.

    The camera and the scanner are not exactly upright to each other: the usual yaw,
    -(pi/2 + rotation_y), is this rotation without a tilt of about a degree.
    """
    height, width, length = box.size_hwl
    middle = np.array(box.location) - [0.0, height / 2, 0.0]
    rect_t_box = Transform(box_rotations(box.rotation_y)[0], middle)
    return Cuboid(
        box.class_name,
        identity,
        rect_T_velo.inverse() @ rect_t_box,
        (length, width, height),
        box.score,
        box.track_id,
    )


def box_of(
    cuboid: Cuboid, rect_T_velo: Transform
) -> tuple[Float64Array, tuple[float, float, float], float]:
    """Return (3,) location, size_hwl and rotation_y of a label; the inverse of cuboid_of."""
    rect_t_box = rect_T_velo @ cuboid.velo_T_box
    length, width, height = cuboid.size_lwh
    forward = rect_t_box.rotation[:, 0]
    location = rect_t_box.translation + np.array([0.0, height / 2, 0.0])
    return location, (height, width, length), float(np.arctan2(-forward[2], forward[0]))


def box_to_velo(
    location: npt.ArrayLike, rotation_y: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a label's location and rotation_y to bottom centre and yaw in velo_link.

    A label's yaw is about the camera's y axis, a tracklet's about the scanner's z axis. The heading
    is carried over as a vector: where the two axes are parallel this is exact, and
    -(pi/2 + rotation_y) up to the small angle between the sensors.
    """
    velo_t_rect = rect_T_velo.inverse()
    heading = velo_t_rect.rotation @ np.array([cos(rotation_y), 0.0, -sin(rotation_y)])
    (centre,) = velo_t_rect.apply(np.reshape(location, (1, 3)))
    return centre, atan2(heading[1], heading[0])


def box_to_rect(
    centre: npt.ArrayLike, yaw: float, rect_T_velo: Transform
) -> tuple[Float64Array, float]:
    """Convert a bottom centre and yaw in velo_link to location and rotation_y, as box_to_velo."""
    heading = rect_T_velo.rotation @ np.array([cos(yaw), sin(yaw), 0.0])
    (location,) = rect_T_velo.apply(np.reshape(centre, (1, 3)))
    return location, atan2(-heading[2], heading[0])


# Overlaps of many pairs of boxes at once.
#
# Empty boxes, and numbers that are not finite, overlap nothing.

if TYPE_CHECKING:
    Indices: TypeAlias = npt.NDArray[np.intp]
    Mask: TypeAlias = npt.NDArray[np.bool_]

_ROUNDING = 1e-12
"""Boxes that only touch, or are side by side, seem to overlap by so much."""
_NO_CUBOID = Cuboid('', '', Transform(np.full((3, 3), np.nan), np.full(3, np.nan)), (np.nan,) * 3)


class Boxed(Protocol):
    """An object with boxes."""

    @property
    def cuboid(self) -> Cuboid | None:
        """3D box in velo_link, None without one."""

    @property
    def box_2d(self) -> tuple[float, float, float, float] | None:
        """left, top, right, bottom, pixels, None without one."""


class OverlappingPairs(NamedTuple):
    """Pairs of objects that overlap, by the first, then by the second.

    Attributes:
        first: (P,) indices in the rows that are compared.
        second: (P,) indices.
        overlaps: (P,) intersection over union (IoU), above 0 by more than rounding.
    """

    first: Indices
    second: Indices
    overlaps: Float64Array


class BoxTable:
    """The boxes of objects, in arrays; NaN where an object has none.

    Attributes:
        flat: (N, 4) left, top, right, bottom of 2D boxes, pixels.

    Args:
        objects: With 3D boxes, 2D boxes, both or none.
    """

    def __init__(self, objects: Sequence[Boxed]) -> None:
        nothing = (np.nan,) * 4
        self.flat = np.array([box.box_2d or nothing for box in objects], float).reshape(-1, 4)
        self._is_solid = np.array([box.cuboid is not None for box in objects], bool)
        cuboids = [box.cuboid or _NO_CUBOID for box in objects]
        self._bottoms = cuboid_corners(cuboids)[:, :4]
        self._sizes = np.array([cuboid.size_lwh for cuboid in cuboids], float).reshape(-1, 3)
        poses = [cuboid.velo_T_box for cuboid in cuboids]
        self._middles = np.array([pose.translation for pose in poses]).reshape(-1, 3)
        self._rotations = np.array([pose.rotation for pose in poses]).reshape(-1, 3, 3)
        self._reaches = np.linalg.norm(self._sizes, axis=1) / 2

    def overlaps(self, others: BoxTable, rows: Indices, compared: Mask) -> OverlappingPairs:
        """Return the pairs that overlap.

        The 3D boxes are compared if both have one, as if they stood on one plane: boxes that are
        tilted against each other upright, as seen along the first one's vertical axis. Else the 2D
        boxes are.

        Args:
            others: M objects.
            rows: (N,) indices of the objects of this table that are compared with them.
            compared: (N, M) pairs that are.
        """
        both = self._is_solid[rows, None] & others._is_solid
        # Axis by axis: np.linalg.norm takes three times as long.
        apart = sum(
            (mine[:, None] - its) ** 2
            for mine, its in zip(self._middles[rows].T, others._middles.T, strict=True)
        )
        near = compared & both & (apart <= (self._reaches[rows, None] + others._reaches) ** 2)
        rest = compared & ~both
        if rest.any():
            rest &= shared_areas_2d(self.flat[rows, None], others.flat) > 0
        first, second = np.nonzero(near | rest)
        ious = ious_2d(self.flat[rows[first]], others.flat[second])
        solid = near[first, second]
        ious[solid] = self._ious_3d(others, rows[first[solid]], second[solid])
        overlapping = ious > _ROUNDING
        return OverlappingPairs(first[overlapping], second[overlapping], ious[overlapping])

    def _ious_3d(self, others: BoxTable, first: Indices, second: Indices) -> Float64Array:
        """Return (P,) IoU of pairs of 3D boxes."""
        sizes, other_sizes = self._sizes[first], others._sizes[second]
        axes, middles = self._rotations[first], self._middles[first]
        corners = (others._bottoms[second] - middles[:, None]) @ axes
        above = ((others._middles[second] - middles) * axes[:, :, 2]).sum(axis=1)
        areas = np.abs(signed_areas(sizes[:, :2].T / 2, corners[:, :, :2].transpose(2, 1, 0)))
        shared = np.minimum(sizes[:, 2], 2 * above + other_sizes[:, 2]) - np.maximum(
            -sizes[:, 2], 2 * above - other_sizes[:, 2]
        )
        volumes = areas * np.maximum(shared, 0.0) / 2
        solid = (sizes > 0).all(axis=1) & (other_sizes > 0).all(axis=1)
        union = sizes.prod(axis=1) + other_sizes.prod(axis=1) - volumes
        return np.where(solid, _ratios(volumes, union), 0.0)


def parts_within(boxes: Float64Array, regions: Float64Array) -> Float64Array:
    """Return (...) parts of (..., 4) rectangles that are within others, 0..1."""
    return _ratios(shared_areas_2d(boxes, regions), shared_areas_2d(boxes, boxes))


def ious_2d(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (...) intersections over union of (..., 4) rectangles left, top, right, bottom."""
    shared = shared_areas_2d(first, second)
    areas = (shared_areas_2d(rectangles, rectangles) for rectangles in (first, second))
    return _ratios(shared, sum(areas) - shared)


def shared_areas_2d(first: Float64Array, second: Float64Array) -> Float64Array:
    """Return (...) areas that (..., 4) rectangles left, top, right, bottom have in common."""
    sides = np.minimum(first[..., 2:], second[..., 2:]) - np.maximum(
        first[..., :2], second[..., :2]
    )
    return np.where((sides > 0).all(axis=-1), sides.prod(axis=-1), 0.0)


def signed_areas(half: Float64Array, corners: Float64Array) -> Float64Array:
    """Return (P,) areas of convex polygons within rectangles, of which 0, 0 is the middle.

    Where the rectangle is |u| <= a and |v| <= b, the area is the integral of v, limited to -b..b,
    along the outline of the polygon within -a..a. That is a sum over its edges, without cases:
    nearly equal and touching rectangles lose no precision.

    Args:
        half: (2, P) a and b.
        corners: (2, V, P) u and v of the corners, in order.

    Returns:
        Positive for corners that go round clockwise, with u to the right and v up, else negative.
    """
    (u, v), (next_u, next_v) = corners, np.roll(corners, -1, axis=1)
    step_u, step_v = next_u - u, next_v - v
    start_u, end_u = np.clip(u, -half[0], half[0]), np.clip(next_u, -half[0], half[0])
    start_v = v + _part(start_u - u, step_u) * step_v
    end_v = next_v - _part(next_u - end_u, step_u) * step_v
    parts = (end_u - start_u) * _mean_within(start_v, end_v, half[1])
    area: Float64Array = parts.sum(axis=0)
    return area


def _ratios(parts: Float64Array, wholes: Float64Array) -> Float64Array:
    """Return parts / wholes; 0 for empty boxes and for numbers that are not finite."""
    valid = (wholes > 0) & np.isfinite(wholes) & np.isfinite(parts)
    return np.divide(parts, wholes, out=np.zeros(np.broadcast(parts, wholes).shape), where=valid)


def _part(part: Float64Array, whole: Float64Array) -> Float64Array:
    """Return part / whole within 0..1, 0 for 0 / 0."""
    ratio = np.divide(part, whole, out=np.zeros_like(part), where=whole != 0)
    return np.clip(ratio, 0.0, 1.0)


def _mean_within(start: Float64Array, end: Float64Array, limit: Float64Array) -> Float64Array:
    """Return the mean over a line from start to end of its values, limited to -limit..limit."""
    step = end - start
    low, high = np.clip(start, -limit, limit), np.clip(end, -limit, limit)
    above = _part(np.maximum(end, limit) - np.maximum(start, limit), step)
    below = _part(np.minimum(end, -limit) - np.minimum(start, -limit), step)
    inside = _part(high - low, step)
    mean = limit * (above - below) + inside * (low + high) / 2
    return np.where(step == 0, low, mean)


# Which predictions find which labels, by the rules of KITTI's devkit.
#
# Source: evaluate_object.cpp of the object devkit. A prediction is a true positive (TP) if its
# intersection over union (IoU) with a label of its class is above 0.7 for cars and 0.5 for
# pedestrians and cyclists, or above a chosen one; another is a false positive (FP), and a label
# that none finds a false negative (FN). Not counted are predictions on a label of a neighbouring
# class (a car on a van, a pedestrian on a person sitting) or within a DontCare region, and labels
# of classes that KITTI does not evaluate. Classes are compared without regard to case.
#
# Other than there, predictions choose by descending score, classes that KITTI does not evaluate
# count when they are predicted, and neither size nor occlusion makes a label too hard to count.

NEIGHBOURS = {
    'car': frozenset({'van'}),
    'pedestrian': frozenset({'person_sitting', 'person (sitting)'}),
}
"""A class that KITTI evaluates, and those that look like it, in lower case."""

_DONT_CARE = DONT_CARE.lower()
_MOST_PAIRS = 2**18
"""Pairs of a prediction and a label that are compared at a time."""
_UNEVALUATED = frozenset(
    {'van', 'truck', 'tram', 'person_sitting', 'person (sitting)', 'misc', _DONT_CARE}
)


class Matchable(Boxed, Protocol):
    """A label or a prediction."""

    @property
    def class_name(self) -> str:
        """Class name."""

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


@np.errstate(all='ignore')  # labels may hold any numbers
def match(
    labels: Sequence[Matchable],
    predictions: Sequence[Matchable],
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
) -> Matches:
    """Compare the predictions of a frame with its labels.

    Args:
        labels: Ground truth, with its DontCare regions.
        predictions: Boxes of any classes; one without a score is the surest.
        overlaps: The IoU above which a prediction finds a label.
    """
    predicted = {prediction.class_name.lower() for prediction in predictions}
    names = [label.class_name.lower() for label in labels]
    of_labels = [
        Match(None if _is_uncounted(name, predicted) else Verdict.FALSE_NEGATIVE) for name in names
    ]
    of_predictions = [Match(Verdict.FALSE_POSITIVE)] * len(predictions)
    for index, overlapped in _overlapped(labels, predictions, overlaps):
        decided = _choose(overlapped, of_labels)
        of_predictions[index] = decided
        if decided.partner is not None:
            of_labels[decided.partner] = decided._replace(partner=index)
    return Matches(of_labels, of_predictions)


class _OverlappedLabels(NamedTuple):
    """The labels that a prediction overlaps.

    Attributes:
        own: Pairs of IoU and negative index, of the class of the prediction.
        near: The same, of the neighbours of its class.
        least: The IoU above which the prediction finds a label.
        is_ignored: Whether it is within a DontCare region.
    """

    own: list[tuple[float, int]]
    near: list[tuple[float, int]]
    least: float
    is_ignored: bool


def _choose(overlapped: _OverlappedLabels, label_matches: Sequence[Match]) -> Match:
    """Return the match of a prediction with the labels that are not taken yet."""
    for verdict, pairs in ((Verdict.TRUE_POSITIVE, overlapped.own), (None, overlapped.near)):
        free = [
            (overlap, index)
            for overlap, index in pairs
            if overlap > overlapped.least and label_matches[-index].partner is None
        ]
        if free:
            overlap, index = max(free)
            return Match(verdict, -index, overlap)
    best, _ = max(overlapped.own, default=(0.0, 0))
    return Match(None if overlapped.is_ignored else Verdict.FALSE_POSITIVE, overlap=best)


def _overlapped(
    labels: Sequence[Matchable], predictions: Sequence[Matchable], overlaps: LeastOverlaps
) -> Iterator[tuple[int, _OverlappedLabels]]:
    """Yield the index of each prediction and the labels it overlaps, by descending score."""
    names = [matchable.class_name.lower() for matchable in labels]
    table, boxes = BoxTable(labels), BoxTable(predictions)
    regions = table.flat[[name == _DONT_CARE for name in names]]
    order = sorted(range(len(predictions)), key=lambda row: -_sureness(predictions[row]))
    step = max(_MOST_PAIRS // max(len(labels), 1), 1)
    for start in range(0, len(order), step):
        rows = np.array(order[start : start + step])
        own = [predictions[row].class_name.lower() for row in rows]
        least = [overlaps.of(name) for name in own]
        parts = parts_within(boxes.flat[rows, None], regions)
        ignored = np.any(parts > np.array(least)[:, None], axis=1).tolist()
        pairs = boxes.overlaps(table, rows, _compared(own, names))
        ends = np.searchsorted(pairs.first, np.arange(len(rows) + 1))
        for index, prediction in enumerate(rows.tolist()):
            mine = slice(*ends[index : index + 2])
            nearby = zip(pairs.overlaps[mine].tolist(), pairs.second[mine].tolist(), strict=True)
            both: tuple[list[tuple[float, int]], list[tuple[float, int]]] = ([], [])
            for overlap, label in nearby:
                both[names[label] != own[index]].append((overlap, -label))
            yield prediction, _OverlappedLabels(*both, least[index], ignored[index])


def _compared(own: Sequence[str], names: Sequence[str]) -> Mask:
    """Return (N, M) whether each label is of the class of each prediction, or of a neighbour."""
    codes = {name: code for code, name in enumerate(dict.fromkeys(names))}
    of_labels = np.array([codes[name] for name in names], np.intp)
    rows = {
        name: np.isin(of_labels, [codes.get(key, -1) for key in (name, *NEIGHBOURS.get(name, ()))])
        for name in set(own)
    }
    return np.array([rows[name] for name in own])


def _sureness(prediction: Matchable) -> float:
    score = prediction.score
    return math.inf if score is None else score if math.isfinite(score) else -math.inf


def _is_uncounted(class_name: str, predicted: set[str]) -> bool:
    return class_name == _DONT_CARE or (class_name in _UNEVALUATED and class_name not in predicted)


# Easy, moderate and hard: the levels of KITTI's object benchmark.
#
# Source: MIN_HEIGHT, MAX_OCCLUSION and MAX_TRUNCATION in evaluate_object.cpp of the object devkit.
# A label counts at a level if its 2D box is at least so high and it is at most so occluded and
# truncated; each level includes the easier ones. Unknown occlusion and truncation, -1, are within
# every limit; occlusion 3, unknown to the annotator, is within none.


class Difficulty(str, Enum):
    """The levels, the easiest first."""

    EASY = 'easy'
    MODERATE = 'moderate'
    HARD = 'hard'


class DifficultyLimits(NamedTuple):
    """The limits of a level.

    Attributes:
        height_px: Least height of the 2D box, pixels.
        occluded: Greatest occlusion, as in Box.
        truncated: Greatest truncation, as in Box.
    """

    height_px: float
    occluded: int
    truncated: float


LIMITS = {
    Difficulty.EASY: DifficultyLimits(40, 0, 0.15),
    Difficulty.MODERATE: DifficultyLimits(25, 1, 0.30),
    Difficulty.HARD: DifficultyLimits(25, 2, 0.50),
}


def difficulty_of(box: Box) -> Difficulty | None:
    """Return the easiest level at which a label counts; None if it counts at none."""
    _, top, _, bottom = box.box_2d
    for level, limits in LIMITS.items():
        if (
            bottom - top >= limits.height_px
            and box.occluded <= limits.occluded
            and box.truncated <= limits.truncated
        ):
            return level
    return None
