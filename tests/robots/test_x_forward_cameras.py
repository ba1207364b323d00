# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras whose frames have x forward, as Waymo's: the front one is chosen, and is told of."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import pytest
import small_rigs
from camera_rigs import pose, turned
from test_surround_rigs import convert, topics  # noqa: F401 - a fixture

from kitti_ros2.cli import main

SIDES = {'SIDE_LEFT': (90.0, 8.0), 'FRONT': (0.0, 0.5), 'SIDE_RIGHT': (-90.0, 7.0)}
"""Yaw and pitch, degrees: z of the side cameras leans ahead."""


@pytest.fixture
def robot():
    cameras = [
        camera_rigs.Camera(f'/camera/{name}', name, pose(turned(*angles), (1.5, 0.0, 2.0)))
        for name, angles in SIDES.items()
    ]
    # Side cameras whose pitch is about the x of the vehicle.
    cameras[0] = replace(cameras[0], base_T_camera=pose(turned(0, 8) @ turned(90), (1, 0, 2.0)))
    return small_rigs.joined(*cameras)


def test_front_is_camera_2_and_its_frame_is_told(convert, robot):  # noqa: F811
    plan, notes, _ = convert(robot)
    assert topics(plan) == {2: '/camera/FRONT/image_rect_color'}
    assert '/camera/FRONT/image_rect_color: z of FRONT, the direction the camera looks in' in notes
    assert 'if it is no optical frame, name one as frame' in notes
    assert 'turn boxes by that angle' not in notes


def test_each_camera_of_the_sets_is_told_of(robot, tmp_path, capsys):
    bag = camera_rigs.write(robot, tmp_path / 'bag')
    assert main(['to-kitti', str(bag), '--layout', 'object', '--all-cameras', '--plan']) == 0
    assert capsys.readouterr().out.count('the direction the camera looks in') == len(SIDES)
