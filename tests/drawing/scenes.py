# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Objects and cameras that the tests of drawing share."""

from __future__ import annotations

import numpy as np

from kitti_ros2.drawing.labelled_objects import LabelledObject
from kitti_ros2.drawing.projection import Projection
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

SIZE = (400, 200)
FOCAL = 200.0
FORWARD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""velo_link's axes to a camera's: x right, y down, z forward."""


def camera(size=SIZE, focal=FOCAL) -> Projection:
    """A pinhole in velo_link's origin that looks along x."""
    k = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Projection(np.column_stack([k @ FORWARD, np.zeros(3)]))


def project(projection: Projection, points):
    """(N, 2) pixels and (N,) depths of (N, 3) points in velo_link."""
    seen = projection.homogeneous(points)
    return projection.pixels(seen), seen[:, 2]


def canvas(size=SIZE):
    return np.zeros((size[1], size[0], 3), np.uint8)


def solid(x, y=0.0, z=0.0, size_lwh=(4.0, 2.0, 1.5), yaw=0.0, kind='Car', **rest) -> LabelledObject:
    """An object with a 3D box whose middle is at x y z of velo_link."""
    pose = Transform(rotation_from_rpy(0.0, 0.0, yaw), np.array([x, y, z], np.float64))
    return LabelledObject(kind, Cuboid(kind, '0', pose, size_lwh), **rest)


def flat(left, top, right, bottom, kind='Car', **rest) -> LabelledObject:
    """An object with a 2D box only."""
    return LabelledObject(kind, None, (left, top, right, bottom), **rest)


def drawn(picture) -> np.ndarray:
    """(H, W) whether a pixel of a black canvas was drawn on, the faint rims of lines left out."""
    return picture.max(axis=2) > 90


def bounds_of(mask) -> tuple[int, int, int, int]:
    """left, top, right, bottom of the pixels that are set."""
    rows, columns = np.nonzero(mask)
    return columns.min(), rows.min(), columns.max(), rows.max()
