# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points of a scan inside 3D boxes: whether there are any, for all boxes of a frame at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import box_rotations

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.boxes import Box, Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Float32Array

_SAMPLED = 16
_MARGIN_M = 0.05
"""Labels have two decimals, and annotators draw boxes close to the points."""


class Places(NamedTuple):
    """The places of boxes in velo_link.

    Attributes:
        middles: (N, 3) metres.
        rotations: (N, 3, 3) velo_R_box.
        halves: (N, 3) half of length, width, height.
    """

    middles: Float64Array
    rotations: Float64Array
    halves: Float64Array

    @classmethod
    def of_boxes(cls, boxes: Sequence[Box], velo_t_rect: Transform) -> Places:
        """Return the places of labels with positive sizes; those of cuboid_of, all at once."""
        location = np.array([box.location for box in boxes], np.float64).reshape(-1, 3)
        halves = np.array([box.size_hwl[::-1] for box in boxes], np.float64).reshape(-1, 3) / 2
        location[:, 1] -= halves[:, 2]
        rotations = box_rotations(np.array([box.rotation_y for box in boxes]))
        return cls(velo_t_rect.apply(location), velo_t_rect.rotation @ rotations, halves)

    @classmethod
    def of_cuboids(cls, cuboids: Sequence[Cuboid]) -> Places:
        """Return the places of tracklets."""
        middles = np.array([each.velo_T_box.translation for each in cuboids], np.float64)
        rotations = np.array([each.velo_T_box.rotation for each in cuboids], np.float64)
        halves = np.array([each.size_lwh for each in cuboids], np.float64) / 2
        return cls(middles.reshape(-1, 3), rotations.reshape(-1, 3, 3), halves.reshape(-1, 3))

    def joined(self, other: Places) -> Places:
        """Return these places, then others."""
        return Places(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def chosen(self, indices: npt.NDArray[np.intp]) -> Places:
        """Return some of the places."""
        return Places(*(each[indices] for each in self))


def any_inside(points: Float32Array, places: Places) -> npt.NDArray[np.bool_]:
    """Whether any point of a scan is inside each box; most are found in a sample of the points.

    Args:
        points: (N, 4).
        places: Of the boxes.
    """
    hit = np.zeros(len(places.middles), np.bool_)
    for step in (_SAMPLED, 1):
        left = np.flatnonzero(~hit)
        if len(left):
            xyz = np.ascontiguousarray(points[::step, :3].T)
            hit[left] = [
                _has_point(xyz, *place) for place in zip(*places.chosen(left), strict=True)
            ]
    return hit


def _has_point(
    xyz: Float32Array, middle: Float64Array, rotation: Float64Array, half: Float64Array
) -> bool:
    radius = np.float32(np.linalg.norm(half) + _MARGIN_M)
    near = np.flatnonzero(np.abs(xyz[0] - np.float32(middle[0])) <= radius)
    near = near[np.abs(xyz[1, near] - np.float32(middle[1])) <= radius]
    own = (xyz[:, near].T - middle) @ rotation
    return bool((np.abs(own) <= half + _MARGIN_M).all(axis=1).any())
