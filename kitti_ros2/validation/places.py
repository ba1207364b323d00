# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Places of 3D boxes in a scan, and which boxes have no point of it inside."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import box_rotations

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Box, Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Float32Array

_SAMPLED = 16
_MARGIN_M = 0.05
"""Labels have two decimals, and annotators draw boxes close to the points."""


class BoxInScan(NamedTuple):
    """A box in velo_link.

    Attributes:
        middle: (3,) metres.
        rotation: (3, 3) velo_R_box.
        half: (3,) half of length, width, height, with a margin.
        radius: Of the sphere around it.
        distance: Of its middle from the scanner.
    """

    middle: Float64Array
    rotation: Float64Array
    half: Float64Array
    radius: np.float32
    distance: float


def places_of_boxes(boxes: Sequence[Box], velo_t_rect: Sequence[Transform]) -> list[BoxInScan]:
    """Return the places of labels with positive sizes, each with the transform of its frame."""
    location = np.array([box.location for box in boxes], np.float64).reshape(-1, 3)
    half = np.array([box.size_hwl[::-1] for box in boxes], np.float64).reshape(-1, 3) / 2
    location[:, 1] -= half[:, 2]
    velo_r_rect, offset = _stacked(velo_t_rect)
    middle = (velo_r_rect @ location[:, :, None])[:, :, 0] + offset
    return _places(middle, velo_r_rect @ box_rotations([box.rotation_y for box in boxes]), half)


def places_of_cuboids(cuboids: Sequence[Cuboid]) -> list[BoxInScan]:
    """Return the places of tracklets."""
    rotation, middle = _stacked([each.velo_T_box for each in cuboids])
    half = np.array([each.size_lwh for each in cuboids], np.float64).reshape(-1, 3) / 2
    return _places(middle, rotation, half)


def _stacked(transforms: Sequence[Transform]) -> tuple[Float64Array, Float64Array]:
    """Return (N, 3, 3) rotations and (N, 3) translations."""
    rotations = np.array([each.rotation for each in transforms], np.float64)
    translations = np.array([each.translation for each in transforms], np.float64)
    return rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)


def _places(middle: Float64Array, rotation: Float64Array, half: Float64Array) -> list[BoxInScan]:
    radius = (np.linalg.norm(half, axis=1) + _MARGIN_M).astype(np.float32)
    distance = np.linalg.norm(middle, axis=1).tolist()
    return list(map(BoxInScan, middle, rotation, half + _MARGIN_M, radius, distance))


def places_without_points(points: Float32Array, places: Sequence[BoxInScan]) -> list[int]:
    """Return the indices of places without a point; most have one in a sample of the points.

    Args:
        points: (N, 4), a scan.
        places: In its frame.
    """
    left = list(range(len(places)))
    for step in (_SAMPLED, 1):
        if left:
            xyz = np.ascontiguousarray(points[::step, :3].T)
            left = [index for index in left if not _has_point(xyz, places[index])]
    return left


def _has_point(xyz: Float32Array, place: BoxInScan) -> bool:
    x, y, _ = place.middle.astype(np.float32)
    near = (np.abs(xyz[0] - x) <= place.radius).nonzero()[0]
    near = near[np.abs(xyz[1, near] - y) <= place.radius]
    own = (xyz[:, near].T - place.middle) @ place.rotation
    return bool((np.abs(own) <= place.half).all(axis=1).any())
