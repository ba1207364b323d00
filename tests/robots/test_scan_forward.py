# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""x of the written scans looks forward, and calibration, labels and poses agree with them."""

from __future__ import annotations

from dataclasses import replace

import camera_rigs
import numpy as np
import pytest
import small_rigs
from camera_rigs import assert_true, moved, pose, read_frame, turned, world
from nuscenes_car import nuscenes_car
from ouster_robot import BASE_T_SENSOR, SENSOR_T_LIDAR, ouster_robot

from kitti_ros2.cli import main
from kitti_ros2.importer.plan import parse_plan


@pytest.fixture
def converted(tmp_path, capsys):
    """Convert a robot's bag, with words of its plan changed; returns plan, notes, split."""

    def run(robot, *changes, layout='object'):
        bag = camera_rigs.write(robot, tmp_path / 'bag')
        assert main(['to-kitti', str(bag), '--layout', layout, '--plan']) == 0
        printed = capsys.readouterr().out
        text = printed
        for before, after in changes:
            assert before in text
            text = text.replace(before, after)
        path = tmp_path / 'plan.yaml'
        path.write_text(text)
        words = ['to-kitti', str(bag), str(tmp_path / 'out'), '--plan-file', str(path)]
        assert main([*words, '--overwrite']) == 0
        return parse_plan(text, path), printed.split('layout:')[0], tmp_path / 'out' / 'training'

    return run


def assert_points(split, base_T_velo):
    """The scans are the true points in a frame of the body."""
    expected = moved(np.linalg.inv(base_T_velo), world())
    np.testing.assert_allclose(read_frame(split, 0).points, expected, atol=1e-4)


def test_os_sensor_is_taken_for_os_lidar(converted):
    robot = ouster_robot()
    plan, notes, split = converted(robot)
    assert (plan.scan.frame, plan.scan.forward) == ('os_sensor', '')
    assert 'os_lidar, whose x looks backward' in notes
    assert 'scan.frame is os_sensor' in notes
    assert_points(split, BASE_T_SENSOR)
    assert_true(split, robot.cameras[0])


@pytest.mark.parametrize('camera', [True, False])
def test_os_sensor_is_forward_without_a_body(converted, camera):
    robot = ouster_robot(body=False, camera=camera)
    plan, notes, split = converted(robot)
    assert plan.scan.frame == 'os_sensor'
    assert 'forward is x of os_sensor' in notes
    if camera:
        assert_true(split, robot.cameras[0])


def test_without_os_sensor_the_scans_get_the_body_s_axes(converted):
    robot = ouster_robot(sensor=False)
    plan, notes, split = converted(robot)
    assert (plan.scan.frame, plan.scan.forward) == ('os_lidar', 'base_link')
    assert 'turned so that x is x of base_link (scan.forward)' in notes
    assert_points(split, pose(np.eye(3), tuple(robot.base_T_lidar[:3, 3])))
    assert_true(split, robot.cameras[0])


def test_without_body_and_os_sensor_the_camera_decides(converted):
    robot = ouster_robot(body=False, sensor=False)
    plan, notes, split = converted(robot)
    assert (plan.scan.frame, plan.scan.forward) == ('os_lidar', '-x')
    assert 'forward is where /front/camera/image_rect_color looks' in notes
    assert_points(split, BASE_T_SENSOR @ SENSOR_T_LIDAR @ pose(turned(180.0), (0.0, 0.0, 0.0)))
    assert_true(split, robot.cameras[0])


def test_without_any_of_them_the_frame_stays(converted):
    robot = ouster_robot(body=False, sensor=False, camera=False)
    plan, notes, _ = converted(robot)
    assert (plan.scan.frame, plan.scan.forward) == ('os_lidar', '')
    assert 'x of os_lidar is taken as forward' in notes


@pytest.mark.parametrize(
    ('forward', 'turn'),
    [
        ('y', turned(90.0)),
        ('-y', turned(-90.0)),
        ('-x', turned(180.0)),
        ('z', np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])),
    ],
)
def test_an_axis_of_the_frame_looks_forward(converted, forward, turn):
    """A lidar whose axes are those of a plan, and no body."""
    robot = small_rigs.sides('front')
    base_T_lidar = pose(small_rigs.LIDAR[:3, :3] @ turn.T, tuple(small_rigs.LIDAR[:3, 3]))
    links = tuple(
        ('rig', child, base_T_lidar if child == 'lidar' else place)
        for _, child, place in robot.links
    )
    robot = replace(robot, links=links, base_T_lidar=base_T_lidar)
    plan, _, split = converted(robot)
    assert plan.scan.forward == forward
    assert_points(split, small_rigs.LIDAR)
    assert_true(split, robot.cameras[0])


def test_x_within_30_degrees_of_forward_stays(converted):
    plan, notes, split = converted(small_rigs.sides('front'))
    assert (plan.scan.frame, plan.scan.forward) == ('lidar', '')
    assert 'scan.forward' not in notes
    assert_points(split, small_rigs.LIDAR)


def test_the_plan_s_forward_is_taken_or_refused_by_name(converted, tmp_path, capsys):
    robot = nuscenes_car()
    _, _, split = converted(robot, ('forward: base_link', 'forward: y'))
    assert_points(split, robot.base_T_lidar @ pose(turned(90.0), (0.0, 0.0, 0.0)))
    assert_true(split, robot.camera('/CAM_FRONT'))
    plan = tmp_path / 'plan.yaml'
    plan.write_text(plan.read_text().replace('forward: y', 'forward: up'))
    words = ['to-kitti', str(tmp_path / 'bag'), str(tmp_path / 'no'), '--plan-file', str(plan)]
    capsys.readouterr()
    assert main(words) == 2
    said = capsys.readouterr().err
    assert 'scan: forward: up; expected x, -x, y, -y, z, camera, or a frame' in said
    assert said.count('\n') == 1


def test_a_given_calibration_is_for_the_frame_of_the_messages(converted, tmp_path, capsys):
    robot = nuscenes_car()
    _, _, split = converted(robot)
    given = split / 'calib/000000.txt'
    words = ['to-kitti', str(tmp_path / 'bag'), '--layout', 'object', '--calib', str(given)]
    capsys.readouterr()
    assert main([*words, '--plan']) == 0
    assert 'frame: LIDAR_TOP\n' in capsys.readouterr().out
