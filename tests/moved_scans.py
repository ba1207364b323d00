# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans on KITTI's grid, and moved as KITTI did."""

from __future__ import annotations

import numpy as np

from kitti_ros2.kitti.scan_grid import compensated, on_grid

TWISTS = {
    'straight': (0.828, 0.0422, 0.02, -0.0005, -0.0011, 0.002),
    'left bend': (1.42, 0.01, 0.013, 0.0008, -0.003, 0.046),
    'right bend': (0.31, -0.004, 0.009, 0.0012, 0.0008, -0.031),
    'motorway': (3.0, 0.02, 0.1, 0.001, 0.003, 0.01),
    'backwards': (-0.2, 0.0, 0.0, 0.0, 0.0, -0.01),
    'standing': (0.0,) * 6,
}


def street(seed, columns=2000):
    """A street between walls, (N, 3) float32 on the grid, as 64 lasers see it."""
    random = np.random.default_rng(seed)
    elevation = np.radians(np.linspace(2, -24.8, 64))[:, None]
    azimuth = np.linspace(-np.pi, np.pi, columns, endpoint=False)
    rays = np.stack(
        np.broadcast_arrays(
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ),
        axis=-1,
    ).reshape(-1, 3)
    with np.errstate(divide='ignore'):
        reach = np.minimum.reduce(
            [
                np.where(rays[:, 2] < 0, -1.73 / rays[:, 2], 99),
                np.abs(7 / rays[:, 1]),
                np.abs(40 / rays[:, 0]),
            ]
        )
    reach *= 1 + 0.02 * random.normal(size=len(reach))
    return on_grid((rays * reach[:, None])[reach < 78])


def moved(points, twist):
    return compensated(points.astype(np.float64), np.array(twist)).astype(np.float32)
