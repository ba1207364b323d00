# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras whose frames have x forward, as Waymo's: the front one is chosen, and is told of."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import pytest
import small_rigs
from camera_rigs import OPTICAL, assert_true, pose, turned
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


def test_front_is_camera_2_and_an_optical_frame_is_made(convert, robot):  # noqa: F811
    plan, notes, split = convert(robot)
    assert topics(plan) == {2: '/camera/FRONT/image_rect_color'}
    assert plan.cameras[2].forward == 'x'
    assert '/camera/FRONT/image_rect_color: z of FRONT is up, so it is taken as a frame' in notes
    assert 'turn boxes by that angle' not in notes
    optical = replace(
        robot.cameras[1], base_T_camera=robot.cameras[1].base_T_camera @ pose(OPTICAL, (0, 0, 0))
    )
    assert_true(split, optical)


def test_each_camera_of_the_sets_is_told_of(robot, tmp_path, capsys):
    bag = camera_rigs.write(robot, tmp_path / 'bag')
    assert main(['to-kitti', str(bag), '--layout', 'object', '--all-cameras', '--plan']) == 0
    said = capsys.readouterr().out
    assert said.count('is up, so it is taken as a frame with x forward') == len(SIDES)
    assert said.count('forward: x') == len(SIDES)


def test_a_forward_that_cannot_be_meant_is_refused(robot, tmp_path, capsys):
    bag = camera_rigs.write(robot, tmp_path / 'bag')
    assert main(['to-kitti', str(bag), '--layout', 'object', '--plan']) == 0
    plan = tmp_path / 'plan.yaml'
    plan.write_text(capsys.readouterr().out.replace('forward: x', 'forward: y'))
    words = ['to-kitti', str(bag), str(tmp_path / 'out'), '--plan-file', str(plan)]
    assert main(words) == 2
    assert 'cameras: 2: forward: y; expected x, or nothing' in capsys.readouterr().err
