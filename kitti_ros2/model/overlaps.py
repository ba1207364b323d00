# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Overlaps of many pairs of boxes at once.

Empty boxes, and numbers that are not finite, overlap nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeAlias

import numpy as np

from .boxes import Cuboid, cuboid_corners
from .geometry import Transform

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from .geometry import Float64Array

    Places: TypeAlias = npt.NDArray[np.intp]
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
        first: (P,) places in the rows that are compared.
        second: (P,) indices.
        overlaps: (P,) intersection over union (IoU), above 0 by more than rounding.
    """

    first: Places
    second: Places
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
        self.flat = np.array([each.box_2d or nothing for each in objects], float).reshape(-1, 4)
        self._is_solid = np.array([each.cuboid is not None for each in objects], bool)
        cuboids = [each.cuboid or _NO_CUBOID for each in objects]
        self._bottoms = cuboid_corners(cuboids)[:, :4]
        self._sizes = np.array([each.size_lwh for each in cuboids], float).reshape(-1, 3)
        poses = [each.velo_T_box for each in cuboids]
        self._middles = np.array([each.translation for each in poses]).reshape(-1, 3)
        self._rotations = np.array([each.rotation for each in poses]).reshape(-1, 3, 3)
        self._reaches = np.linalg.norm(self._sizes, axis=1) / 2

    def overlaps(self, others: BoxTable, rows: Places, compared: Mask) -> OverlappingPairs:
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
        found = ious_2d(self.flat[rows[first]], others.flat[second])
        solid = near[first, second]
        found[solid] = self._ious_3d(others, rows[first[solid]], second[solid])
        kept = found > _ROUNDING
        return OverlappingPairs(first[kept], second[kept], found[kept])

    def _ious_3d(self, others: BoxTable, first: Places, second: Places) -> Float64Array:
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
    areas = (shared_areas_2d(each, each) for each in (first, second))
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
