# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds with points that are no returns, as drivers fill them in: zeros, NaN, range 0, the robot.

As ouster_ros fills a cloud: a row for each beam, x y z 0 and range 0 without a return. Others
transform such clouds, which moves the zeros, or flatten them to one row.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import clocks_apart as base
import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

ROWS, COLUMNS = 16, 64
ZEROS, NOT_FINITE, MOVED, NEAR = 130, 17, 23, 40
"""Points of each kind in every scan."""

POINT = [*base.POINT[:4], ('range', '<u4')]


def points(number: int) -> tuple[np.ndarray, np.ndarray]:
    """All points of a cloud, and the indices of the returns beyond a metre."""
    rng = np.random.default_rng(number)
    count = ROWS * COLUMNS
    made = np.zeros(count, POINT)
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    made['x'], made['y'] = 9 * np.cos(angles), 9 * np.sin(angles)
    made['z'] = rng.uniform(-1, 1, count)
    made['intensity'] = number / 255
    made['range'] = 9000
    order = rng.permutation(count)
    zeros, broken, moved, near, good = np.split(order, np.cumsum([ZEROS, NOT_FINITE, MOVED, NEAR]))
    for name in 'xyz':
        made[name][zeros] = 0
        made[name][near] /= 20
    made['range'][zeros] = 0
    made['y'][broken] = np.nan
    made['range'][moved] = 0
    made['x'][moved], made['y'][moved], made['z'][moved] = 0.4, 0.0, 1.2
    return made, np.sort(good)


def write(path: Path, *, organised: bool) -> Path:
    shape = (ROWS, COLUMNS) if organised else None
    found = []
    for topic, log_ns, message in base.messages(base.Robot()):
        if topic == '/points':
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            number = sum(each[0] == '/points' for each in found)
            message = base.cloud(points(number)[0], stamp, shape=shape)  # noqa: PLW2901
        found.append((topic, log_ns, message))
    return base.write(path, found)
