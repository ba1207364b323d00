# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points as a scanner measures them that turns while the car drives.

The exact scan is a snapshot at the moment of facing forward. Each of its points is measured at the
moment at which the moving scanner faces it: clockwise seen from above, from the rear to the rear.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .rig import CAR_T_VELO

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from .path import Course

_KNOTS = 201
_ROUNDS = 40
_SETTLED_S = 1e-9


def measure(
    points: Float32Array, course: Course, forward_s: float, half_turn_s: float
) -> Float32Array:
    """Return the points as measured, those that the scanner faces, in their order.

    Args:
        points: (N, 4) of a snapshot at forward_s, velo_link.
        course: The motion of the car.
        forward_s: The moment of facing forward, seconds.
        half_turn_s: Half the length of a turn, seconds.
    """
    knots = np.linspace(-2 * half_turn_s, 2 * half_turn_s, _KNOTS) + forward_s
    poses = np.array([_pose(course, time) for time in knots.tolist()]).T
    x, y = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    forward_x, forward_y, forward_yaw = _pose(course, forward_s)
    c, s = np.cos(forward_yaw), np.sin(forward_yaw)
    street_x, street_y = forward_x + c * x - s * y, forward_y + s * x + c * y
    times = np.full(len(points), forward_s)
    before = times.copy()
    changing = np.arange(len(points))
    for _ in range(_ROUNDS):
        at_x, at_y, yaw = (np.interp(times[changing], knots, column) for column in poses)
        c, s = np.cos(yaw), np.sin(yaw)
        away_x, away_y = street_x[changing] - at_x, street_y[changing] - at_y
        x[changing] = c * away_x + s * away_y
        y[changing] = c * away_y - s * away_x
        before[changing] = times[changing]
        times[changing] = forward_s - np.arctan2(y[changing], x[changing]) / np.pi * half_turn_s
        changing = changing[times[changing] != before[changing]]
    measured = points.copy()
    measured[:, 0], measured[:, 1] = x, y
    settled: Float32Array = measured[np.abs(times - before) < _SETTLED_S]
    return settled


def _pose(course: Course, time: float) -> tuple[float, float, float]:
    """Return x, y and yaw of the scanner in the street frame."""
    car_x = course.ego_x(time)
    yaw = course.yaw(car_x)
    ahead: Float64Array = CAR_T_VELO.translation
    return (
        car_x + float(ahead[0] * np.cos(yaw)),
        course.y(car_x) + float(ahead[0] * np.sin(yaw)),
        yaw,
    )
