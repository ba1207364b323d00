# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Forward of a robot, by the names and places of its frames."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from kitti_ros2.messages.tf_tree import (
    AXES,
    FrameTree,
    describe_direction,
    find_body,
    is_optical,
    known_heading,
    nearest_axis,
)
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

NOWHERE = Transform.identity()


@pytest.mark.parametrize('axis', list(AXES))
def test_axes_are_rotations_whose_first_column_is_the_axis(axis):
    rotation = AXES[axis]
    np.testing.assert_array_equal(rotation.T @ rotation, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1)
    expected = np.eye(3)['xyz'.index(axis[-1])] * (-1 if axis[0] == '-' else 1)
    np.testing.assert_array_equal(rotation[:, 0], expected)
    near = rotation @ rotation_from_rpy(0.2, -0.3, 0.5)
    assert nearest_axis(near) == axis


@pytest.mark.parametrize(
    ('frames', 'body'),
    [
        (('base_link', 'lidar'), 'base_link'),
        (('base_footprint', 'base_link', 'lidar'), 'base_link'),
        (('robot1/base_link', 'lidar'), 'robot1/base_link'),
        (('Base_Link', 'lidar'), 'Base_Link'),
        (('husky_base_link', 'lidar'), 'husky_base_link'),
        (('chassis', 'lidar'), 'chassis'),
        (('velodyne_base_link', 'lidar'), None),
        (('rig', 'lidar'), None),
    ],
)
def test_the_body_is_found_by_its_name(frames, body):
    links = [(a, b, NOWHERE) for a, b in pairwise(frames)]
    found = find_body(FrameTree(links), ['lidar'])
    assert (found and found.frame) == body


def test_a_body_that_is_joined_to_no_sensor_is_none():
    tree = FrameTree([('base_link', 'wheel', NOWHERE)], [('base_link', 'lidar')])
    assert find_body(tree, ['lidar', '']) is None


def test_frames_of_known_axes():
    tree = FrameTree([('a/os_sensor', 'a/os_lidar', NOWHERE)])
    assert known_heading(tree, 'a/os_lidar').frame == 'a/os_sensor'
    assert known_heading(tree, 'os_lidar') is None
    assert known_heading(tree, 'eye_optical_frame').rotation is AXES['z']
    assert is_optical('camera0/camera_optical_link')
    assert not is_optical('optical_bench')


@pytest.mark.parametrize(
    ('direction', 'text'),
    [
        ((1, 0, 0), 'forward'),
        ((-1, 0.01, 0), 'backward'),
        ((0, 2, 0), '90 degrees to the left'),
        ((1, -1, 0.2), '45 degrees to the right'),
        ((0.1, 0, 1), '84 degrees up'),
        ((0, 0, -3), '90 degrees down'),
    ],
)
def test_directions_are_told_as_angles(direction, text):
    assert describe_direction(np.array(direction, float)) == text
