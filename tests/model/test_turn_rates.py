# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Turn rates of routes, and rates over missing poses."""

from __future__ import annotations

import numpy as np

from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.recording import route_of
from kitti_ros2.model.samples import Pose

START = 1_317_042_145_951_199_337
PERIOD = 100_000_000


def at(number, rate=None, tilt=0.0):
    """A pose on a circle of 10 m, at 0.5 rad/s counter-clockwise and 5 m/s."""
    yaw = 0.05 * number
    place = 10 * np.array([np.sin(yaw), -np.cos(yaw), 0.01 * number])
    angular = None if rate is None else np.array([0.0, 0.0, rate])
    return Pose(Transform(rotation_from_rpy(tilt, 0, yaw), place), None, angular)


def route_at(*numbers, **options):
    stamps = [START + number * PERIOD for number in numbers]
    return route_of(stamps, [at(number, **options) for number in numbers])


def test_missing_poses_change_no_rate():
    whole, holed = route_at(*range(140)), route_at(*range(40), *range(43, 90), *range(95, 140))
    for route in (whole, holed):
        assert not route.measured
        np.testing.assert_allclose(route.turn_rates_rad_s, 0.5)
        np.testing.assert_allclose(route.speeds_m_s, 5.1, rtol=0.01)
    assert abs(whole.length_m - holed.length_m) < 0.1
    assert whole.jumps == holed.jumps == 0


def test_turn_rates_are_continuous_over_a_whole_turn():
    assert np.ptp(route_at(*range(300)).turn_rates_rad_s) < 1e-9


def test_measured_turn_rates_are_about_the_vertical():
    np.testing.assert_allclose(route_at(0, 1, 2, rate=0.7).turn_rates_rad_s, 0.7)
    tilted = route_at(0, 1, 2, rate=0.7, tilt=np.pi / 3)
    np.testing.assert_allclose(tilted.turn_rates_rad_s, 0.35)


def test_heights_are_no_part_of_the_length_over_the_ground():
    route = route_at(*range(140))
    np.testing.assert_allclose(route.ground_m, 139 * 0.5, rtol=1e-3)
    assert route.length_m > route.ground_m + 1


def test_equal_stamps_have_no_rate():
    route = route_of([START, START, START + PERIOD], [at(0), at(0.001), at(1)])
    assert np.isnan(route.turn_rates_rad_s[1])
    assert np.isfinite(route.turn_rates_rad_s[2])
