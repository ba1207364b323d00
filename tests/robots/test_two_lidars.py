# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Of several lidars the one whose points the camera sees becomes the scans."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import clocks_apart as base
import numpy as np
import pytest

from kitti_ros2.importer.apply_plan import guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions

if TYPE_CHECKING:
    from pathlib import Path

    from kitti_ros2.importer.guess import Guess

AHEAD, AROUND = (-60, 60), (-180, 180)


def points_of(view: tuple[int, int], count: int) -> np.ndarray:
    """Points of a scanner, 8 m away, by the degrees that it sees of its own x."""
    angles = np.radians(np.linspace(*view, count, endpoint=False))
    made = np.zeros(count, base.POINT[:4])
    made['x'], made['y'] = 8 * np.cos(angles), 8 * np.sin(angles)
    made['intensity'] = 0.5
    return made


def link(child: str, yaw_deg: float) -> Any:
    """A scanner half a metre above the robot's, turned."""
    found = base.static_tf(base.START_NS).transforms[0]
    half = np.radians(yaw_deg) / 2
    turn = base.TYPES['geometry_msgs/msg/Quaternion'](0.0, 0.0, np.sin(half), np.cos(half))
    found.transform.rotation = turn
    found.transform.translation.x, found.transform.translation.z = 0.0, 0.5
    found.child_frame_id = child
    return found


def guessed(path: Path, lidars: dict[str, tuple[np.ndarray, float]], *, joined: bool) -> Guess:
    """The plan for a robot with a camera that looks ahead, and lidars: points, and their yaw."""
    found = []
    for topic, log_ns, message in base.messages(base.Robot()):
        if topic == '/tf_static':
            message.transforms += [link(name, yaw) for name, (_, yaw) in lidars.items()]
            if not joined:
                continue
        if topic == '/points':
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            for name, (points, _) in lidars.items():
                found.append((f'/{name}/points', log_ns, base.cloud(points, stamp_ns, name)))
        else:
            found.append((topic, log_ns, message))
    survey = survey_bags([base.write(path, found)])
    return guess([path], survey, ImportOptions(layout=Layout.OBJECT))


@pytest.mark.parametrize(
    ('lidars', 'taken'),
    [
        ({'lidar_front': (AHEAD, 60, 0), 'lidar_rear': (AHEAD, 90, 180)}, 'lidar_front'),
        ({'lidar_rear': (AHEAD, 900, 180), 'lidar_front': (AHEAD, 60, 0)}, 'lidar_front'),
        ({'lidar_left': (AHEAD, 900, 110), 'lidar_top': (AROUND, 200, 0)}, 'lidar_top'),
        ({'lidar_bumper': (AHEAD, 100, 0), 'lidar_top': (AROUND, 200, 90)}, 'lidar_top'),
        ({'lidar_side': (AHEAD, 70, 80), 'lidar_front': (AHEAD, 60, 0)}, 'lidar_front'),
        ({'lidar_back': (AHEAD, 100, 180), 'lidar_side': (AHEAD, 70, 120)}, 'lidar_back'),
    ],
)
def test_the_lidar_that_the_camera_sees_goes_before_a_larger_one(lidars, taken, tmp_path):
    made = {name: (points_of(*view), yaw) for name, (*view, yaw) in lidars.items()}
    found = guessed(tmp_path / 'bag', made, joined=True)
    assert found.plan.scan.topic == f'/{taken}/points'
    (other,) = set(made) - {taken}
    assert f'passed over for scans: /{other}/points ({base.FRAMES})' in found.notes
    said = f'scans: the camera sees less than half as many points of /{other}/points as of others'
    both = taken == 'lidar_top' and other == 'lidar_bumper'
    none = taken == 'lidar_back'
    assert (said in found.notes) is not (both or none)
    largest = 'scans: the largest of 2 lidars is taken, for the camera sees points of none'
    assert any(note.startswith(largest) for note in found.notes) is none


def test_without_transforms_the_largest_is_taken_and_that_is_said(tmp_path):
    made = {'lidar_front': (points_of(AHEAD, 60), 0), 'lidar_rear': (points_of(AHEAD, 90), 180)}
    found = guessed(tmp_path / 'bag', made, joined=False)
    assert found.plan.scan.topic == '/lidar_rear/points'
    assert (
        'scans: the largest of 2 lidars is taken, for no transforms tell what the camera sees;'
        ' scan.topic of the plan chooses another'
    ) in found.notes


def test_of_two_planar_scanners_the_one_that_is_seen_goes_before_the_faster_one(tmp_path):
    found = []
    for topic, log_ns, message in base.messages(base.Robot()):
        if topic == '/tf_static':
            message.transforms += [link('laser_front', 0), link('laser_rear', 180)]
        if topic == '/points':
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            names = ['laser_front', 'laser_rear', 'laser_rear']
            found += [
                (f'/{name}', log_ns + place, planar_scan(stamp_ns + place * 10**7, name))
                for place, name in enumerate(names)
            ]
        else:
            found.append((topic, log_ns, message))
    survey = survey_bags([base.write(tmp_path / 'bag', found)])
    guessed_plan = guess([tmp_path / 'bag'], survey, ImportOptions(layout=Layout.OBJECT)).plan
    assert guessed_plan.scan.topic == '/laser_front'


def planar_scan(stamp_ns: int, frame: str) -> Any:
    return base.TYPES['sensor_msgs/msg/LaserScan'](
        header=base.header(stamp_ns, frame),
        angle_min=-1.0,
        angle_max=1.0,
        angle_increment=0.02,
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.1,
        range_max=30.0,
        ranges=np.full(101, 8, np.float32),
        intensities=np.zeros(0, np.float32),
    )
