# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses between poses, and KITTI's camera poses of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.importer.set_builder import camera_poses
from kitti_ros2.messages.moving_tree import MAX_GAP_NS, PoseTrack, interpolate
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

T0 = 1317042145951199337
STEP = 100_000_000
ANGLES = st.floats(-3.1, 3.1)
METRES = st.floats(-1e3, 1e3)
SHARES = st.floats(0, 1)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(ANGLES, st.floats(-1.5, 1.5), ANGLES),
    st.tuples(METRES, METRES, METRES),
)
TRACKS = st.lists(TRANSFORMS, min_size=1, max_size=6)
IDENTITY = Transform.identity()


def at(x):
    return Transform.from_translation((x, 0, 0))


def close(a, b, tolerance=1e-9):
    return a is not None and np.allclose(a.matrix(), b.matrix(), rtol=0, atol=tolerance)


def turn(a, b):
    """The angle between two rotations, exact also where it is small."""
    relative = a.rotation.T @ b.rotation
    sine = np.linalg.norm(relative - relative.T) / np.sqrt(8)
    return np.arctan2(sine, (np.trace(relative) - 1) / 2)


@given(TRACKS)
def test_a_track_goes_through_its_poses(transforms):
    stamps = T0 + np.arange(len(transforms)) * STEP
    poses = PoseTrack(stamps, transforms).at(stamps)
    assert all(close(*pair, 0) for pair in zip(poses, transforms, strict=True))


@given(TRANSFORMS, TRANSFORMS, SHARES)
def test_between_two_poses_the_way_is_straight_and_the_turn_even(start, end, share):
    pose = interpolate(start, end, share)
    straight = start.translation + share * (end.translation - start.translation)
    np.testing.assert_allclose(pose.translation, straight, rtol=0, atol=1e-9)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-9)
    whole = turn(start, end)
    assert turn(start, pose) == pytest.approx(share * whole, abs=1e-7)
    assert turn(pose, end) == pytest.approx((1 - share) * whole, abs=1e-7)


@given(TRANSFORMS, TRANSFORMS, SHARES)
def test_the_way_back_is_the_same_way(start, end, share):
    if turn(start, end) < 3.14:  # half a turn has two short ways round
        assert close(interpolate(start, end, share), interpolate(end, start, 1 - share))


@given(TRANSFORMS, st.floats(-3.1, 3.1), SHARES)
def test_a_turn_about_one_axis_is_exact(start, yaw, share):
    end = start @ Transform(rotation_from_rpy(0, 0, yaw), np.zeros(3))
    expected = start @ Transform(rotation_from_rpy(0, 0, share * yaw), np.zeros(3))
    assert close(interpolate(start, end, share), expected)


@pytest.mark.parametrize('yaw', [0, 1e-300, 1e-12, 1e-8, 1e-4])
def test_a_small_turn_is_exact_too(yaw):
    end = Transform(rotation_from_rpy(0, 0, yaw), np.zeros(3))
    halfway = interpolate(IDENTITY, end, 0.5)
    assert halfway.rotation[1, 0] == pytest.approx(np.sin(yaw / 2), rel=1e-9, abs=1e-300)


@given(TRACKS, TRANSFORMS)
def test_interpolating_elsewhere_is_interpolating_here(transforms, world_t_map):
    """Linear and slerp do not depend on the fixed frame."""
    stamps = T0 + np.arange(len(transforms)) * STEP
    between = np.arange(T0, stamps[-1] + 1, STEP // 3)
    here = PoseTrack(stamps, transforms).at(between)
    there = PoseTrack(stamps, [world_t_map @ transform for transform in transforms]).at(between)
    for a, b in zip(here, there, strict=True):
        if all(turn(*pair) < 3.1 for pair in pairwise(transforms)):
            assert close(world_t_map @ a, b, 1e-6)


def test_nothing_is_extrapolated():
    track = PoseTrack([T0, T0 + STEP], [at(0), at(1)])
    wanted = np.array([T0 - 1, T0, T0 + STEP // 4, T0 + STEP, T0 + STEP + 1])
    poses = track.at(wanted)
    assert [pose and pose.translation[0] for pose in poses] == [None, 0, 0.25, 1, None]


def test_poses_are_sorted_and_of_equal_stamps_the_first_counts():
    track = PoseTrack([T0 + STEP, T0, T0 + STEP], [at(1), at(0), at(7)])
    assert len(track) == 2
    assert track.stamps_ns.tolist() == [T0, T0 + STEP]
    assert track.at(np.array([T0 + STEP // 2]))[0].translation[0] == 0.5


def test_a_gap_is_not_bridged_but_its_ends_are_known():
    tenth = MAX_GAP_NS // 10
    track = PoseTrack([x * tenth for x in (0, 10, 21, 31)], [at(x) for x in (0, 10, 21, 31)])
    poses = track.at(np.array([5, 10, 11, 20, 21, 25]) * tenth)
    assert [pose and pose.translation[0] for pose in poses] == [5, 10, None, None, 21, 25]
    assert PoseTrack([0, MAX_GAP_NS + 1], [at(0), at(1)]).at(np.array([1])) == [None]
    assert PoseTrack([0, MAX_GAP_NS], [at(0), at(1)]).at(np.array([1])) != [None]


def test_a_track_of_no_poses_knows_none():
    assert PoseTrack([], []).at(np.array([1, 2])) == [None, None]
    assert camera_poses(PoseTrack([], []), np.array([1, 2]), IDENTITY) == [None, None]


def test_a_stamp_without_a_pose_is_refused():
    with pytest.raises(ValueError, match='1 poses with stamps of shape'):
        PoseTrack([1, 2], [IDENTITY])


@given(TRACKS, TRANSFORMS)
def test_camera_poses_lead_back_to_the_body(transforms, body_t_cam0):
    stamps = T0 + np.arange(len(transforms)) * STEP
    poses = camera_poses(PoseTrack(stamps, transforms), stamps, body_t_cam0)
    start = transforms[0] @ body_t_cam0
    for pose, map_t_body in zip(poses, transforms, strict=True):
        assert pose.shape == (3, 4)
        first_cam0_t_cam0 = Transform.from_matrix(pose)
        assert close(start @ first_cam0_t_cam0 @ body_t_cam0.inverse(), map_t_body, 1e-8)


def test_camera_poses_have_the_axes_of_the_camera_and_begin_with_the_first_known():
    """Driving forward, x of the body, is z of the camera; the camera's place does not matter."""
    body_r_cam0 = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    body_t_cam0 = Transform(body_r_cam0, np.array([1.0, 0.5, 1.6]))
    track = PoseTrack([T0, T0 + STEP], [at(2), at(4)])
    frames = np.array([T0 - STEP, T0 + STEP // 2, T0 + STEP, T0 + 2 * STEP])
    before, first, second, after = camera_poses(track, frames, body_t_cam0)
    assert before is None
    assert after is None
    np.testing.assert_allclose(first, np.eye(4)[:3], atol=1e-12)
    np.testing.assert_allclose(second, [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1]], atol=1e-12)


def test_far_from_the_origin_no_digit_is_lost():
    far = np.array([4.5e5, 5.4e6, 0])
    rotation = rotation_from_rpy(0.1, 0.2, 0.3)
    step = rotation @ np.array([0.5, 0.25, 0])
    poses = [Transform(rotation, far), Transform(rotation, far + step)]
    found = camera_poses(PoseTrack([0, 1], poses), np.array([0, 1]), IDENTITY)
    moved = rotation.T @ ((far + step) - far)
    np.testing.assert_allclose(found[1][:, 3], moved, rtol=0, atol=1e-13)
