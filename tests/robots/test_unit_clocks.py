# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A receiver with a clock of its own: packets of oxts are those of the frames."""

from __future__ import annotations

from dataclasses import replace

import clocks_apart as robots
import numpy as np
import pytest

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

TYPES = robots.TYPES
S = 10**9


def fix(time_ns, stamp_ns):
    """Latitude grows by 1e-4 degrees a second."""
    status = TYPES['sensor_msgs/msg/NavSatStatus'](0, 1)
    latitude = 49.0 + 1e-4 * (time_ns - robots.START_NS) / 1e9
    header = robots.header(stamp_ns, 'gps')
    return TYPES['sensor_msgs/msg/NavSatFix'](
        header, status, latitude, 8.4, 110.0, np.diag([0.04] * 3).ravel(), 2
    )


def imu(time_ns, stamp_ns):
    """The acceleration ahead grows by 1 m/s2 a second."""
    vector = TYPES['geometry_msgs/msg/Vector3']
    ahead = (time_ns - robots.START_NS) / 1e9
    return TYPES['sensor_msgs/msg/Imu'](
        robots.header(stamp_ns, 'lidar'),
        TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
        np.zeros(9),
        vector(0.0, 0.0, 0.0),
        np.zeros(9),
        vector(ahead, 0.0, 9.81),
        np.zeros(9),
    )


def recorded(path, fix_ns=0, imu_ns=0):
    found = [message for message in robots.messages(robots.Robot()) if message[0] != '/odom']
    for place in range(-50, 10 * robots.FRAMES + 50):
        at = robots.START_NS + place * 10_000_000
        found.append(('/imu', at + 1_000_000, imu(at, at + imu_ns)))
        if place % 20 == 0:
            found.append(('/fix', at + 1_000_000, fix(at, at + fix_ns)))
    return robots.write(path, sorted(found, key=lambda each: each[1]))


def packets(out):
    folder = next(out.rglob('oxts/data'))
    return np.array([np.loadtxt(path) for path in sorted(folder.iterdir())])


@pytest.mark.parametrize(
    ('fix_ns', 'imu_ns'), [(0, 0), (18 * S, 0), (0, -3600 * S), (37 * S, 37 * S)]
)
def test_packets_are_those_of_the_frames(fix_ns, imu_ns, tmp_path):
    bag = recorded(tmp_path / 'bag', fix_ns, imu_ns)
    survey, options = survey_bags([bag]), ImportOptions(layout=Layout.RAW)
    plan = guess([bag], survey, options).plan
    assert (plan.fix_offset_s, plan.imu_offset_s) == (-fix_ns / 1e9, -imu_ns / 1e9)
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    assert report.losses == ()
    found = packets(tmp_path / 'out')
    seconds = np.arange(robots.FRAMES) * 0.1
    assert found[:, 0] == pytest.approx(49.0 + 1e-4 * seconds, abs=1e-9)
    assert found[:, 11] == pytest.approx(seconds, abs=0.011)


def test_a_receiver_without_a_common_time_is_a_loss(tmp_path):
    bag = recorded(tmp_path / 'bag', 18 * S)
    survey, options = survey_bags([bag]), ImportOptions(layout=Layout.RAW)
    plan = replace(guess([bag], survey, options).plan, fix_offset_s=0.0)
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    (loss,) = report.losses
    assert loss.stream == '/fix'
    assert 'set fix_offset_s: -18.0 in the plan' in loss.text()
