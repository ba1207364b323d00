# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses and their stamps, read from every type of message that has them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.messages.camera_info import make_transform
from kitti_ros2.messages.cdr import make_header, make_pose
from kitti_ros2.messages.oxts import (
    encode_odometry,
    encode_path,
    encode_tf,
    poses_of,
    poses_of_link,
)
from kitti_ros2.messages.ros_types import Point, PoseStamped, Quaternion, TFMessage, Vector3
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import Pose, Trajectory

T0 = 1317042145951199337
ANGLES = st.floats(-3.1, 3.1)
METRES = st.floats(-1e3, 1e3)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES),
    st.tuples(METRES, METRES, METRES),
)
IDENTITY = Transform.identity()


def at(x):
    return Transform.from_translation((x, 0, 0))


@given(TRANSFORMS)
def test_poses_come_back_from_messages(transform):
    frames = ('map', 'base_link')
    path = Trajectory(np.array([T0, T0 + 5]), [transform, at(1)])
    for found in (
        poses_of(encode_odometry(Pose(transform), IDENTITY, T0, frames)),
        poses_of(PoseStamped(make_header(T0, 'map'), make_pose(transform))),
        poses_of(encode_path(path, IDENTITY, 9, 'map'))[:1],
        poses_of_link(encode_tf(Pose(transform), IDENTITY, T0, frames), frames),
    ):
        ((stamp_ns, pose),) = found
        assert stamp_ns == T0
        np.testing.assert_allclose(pose.matrix(), transform.matrix(), rtol=0, atol=1e-9)
    assert [stamp_ns for stamp_ns, _ in poses_of(encode_path(path, IDENTITY, 9, 'map'))] == [
        T0,
        T0 + 5,
    ]


def test_of_a_tf_message_the_wanted_link_is_read_and_slashes_do_not_count():
    broken = make_transform(at(1), T0, 'odom', 'wheel')
    broken.transform.rotation = Quaternion(0.0, 0.0, 0.0, 0.0)
    message = TFMessage(
        [
            make_transform(at(1), T0, '/map', '/odom'),
            broken,
            make_transform(at(2), T0 + 1, 'odom', 'base'),
            make_transform(at(3), T0 + 2, 'base', 'odom'),
        ]
    )
    assert [stamp_ns for stamp_ns, _ in poses_of_link(message, ('map', 'odom'))] == [T0]
    assert [stamp_ns for stamp_ns, _ in poses_of_link(message, ('odom', 'base'))] == [T0 + 1]
    assert poses_of_link(message, ('map', 'base')) == []


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(
    ('orientation', 'x'),
    [
        ((0.0, 0.0, 0.0, 0.0), 1.0),
        ((np.nan, 0.0, 0.0, 1.0), 1.0),
        ((0.0, 0.0, 0.0, 1.0), np.inf),
        ((1e300, 0, 0, 1e300), 1.0),
        ((0.0, 0, 0, 1), 1e300),
    ],
)
def test_what_is_no_pose_is_refused(orientation, x):
    pose = make_pose(IDENTITY)
    pose.orientation, pose.position = Quaternion(*orientation), Point(x, 0.0, 0.0)
    link = make_transform(IDENTITY, T0, 'map', 'base')
    link.transform.rotation = Quaternion(*orientation)
    link.transform.translation = Vector3(x, 0.0, 0.0)
    with pytest.raises(
        ValueError, match='a pose of NaN, of an impossible place or of an orientation'
    ):
        poses_of(PoseStamped(make_header(T0, 'map'), pose))
    with pytest.raises(ValueError, match='a pose of NaN'):
        poses_of_link(TFMessage([link]), ('map', 'base'))
