# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The geometry of motion compensation, against a transform of each point of its own."""

from __future__ import annotations

import warnings

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.model.geometry import Transform
from kitti_ros2.model.recording import (
    ScannerMotion,
    compensate,
    exponential,
    make_twist,
    move_rigidly,
    turned,
    twist_of,
    undo_compensation,
)
from kitti_ros2.model.samples import Turn

START_NS = 1_316_995_200_000_000_000
TURN = Turn(START_NS, 103_600_000)
FORWARD_NS = TURN.forward_ns
MILLISECOND = 1_000_000

speeds = st.tuples(st.floats(-40, 40), st.floats(-3, 3), st.floats(-3, 3)).map(np.array)
rates = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-2, 2)).map(np.array)
twists = st.builds(make_twist, speeds, rates)
seeds = st.integers(0, 2**32 - 1)


def series_of(matrix):
    """The exponential of a matrix, by squaring that of its 1024th part."""
    part, total, power = matrix / 1024, np.eye(4), np.eye(4)
    for order in range(1, 12):
        power = power @ part / order
        total = total + power
    for _ in range(10):
        total = total @ total
    return total


@st.composite
def motions(draw):
    """A motion that changes at three moments in or near the turn."""
    offsets = draw(st.lists(st.integers(-60, 160), min_size=3, max_size=3, unique=True))
    stamps_ns = [START_NS + offset * MILLISECOND for offset in sorted(offsets)]
    return ScannerMotion.from_twists(stamps_ns, np.stack([draw(twists) for _ in range(3)]))


def poses_of(motion, moments_ns):
    """The pose at each moment in that of the first stamp, by small steps of the series."""
    found = []
    for moment in moments_ns:
        first = int(motion.stamps_ns[0])
        pose, at = np.eye(4), first
        bounds = [int(each) for each in motion.stamps_ns if first < each < moment]
        if moment < first:
            found.append(series_of(motion.twists[0] * (moment - first) / 1e9))
            continue
        for bound in [*bounds, moment]:
            place = int((motion.stamps_ns <= at).sum())
            pose, at = pose @ series_of(motion.twists[place] * (bound - at) / 1e9), bound
        found.append(pose)
    return found


def points_of(seed, count=60, nearest=1.0, farthest=120.0):
    rng = np.random.default_rng(seed)
    azimuth, ranges = rng.uniform(-np.pi, np.pi, count), rng.uniform(nearest, farthest, count)
    place = (ranges * np.cos(azimuth), ranges * np.sin(azimuth), rng.uniform(-3, 3, count))
    return np.stack([*place, rng.uniform(0, 1, count)], axis=1).astype(np.float32)


def distances(one, other):
    return np.linalg.norm(one[:, :3].astype(np.float64) - other[:, :3], axis=1)


@given(twists)
def test_the_exponential_is_the_series(twist):
    assert np.allclose(exponential(twist), series_of(twist), rtol=0, atol=1e-9)


@given(twists, st.sampled_from([1.0, 0.1, 0.0099, 1e-5, 1e-9, 0.0]))
def test_a_twist_and_its_transform_are_inverse(twist, seconds):
    transform = Transform.from_matrix(exponential(twist * seconds))
    assert np.allclose(twist_of(transform), twist * seconds, rtol=0, atol=1e-8)


@given(motions(), st.integers(-100, 300), st.integers(-100, 300))
def test_the_motion_between_two_moments(motion, one, other):
    moments = [START_NS + each * MILLISECOND for each in (one, other)]
    first, second = poses_of(motion, moments)
    expected = np.linalg.inv(first) @ second
    assert np.allclose(motion.relative(*moments), expected, rtol=0, atol=1e-7)


@given(motions(), seeds, st.sampled_from([0, 51_800_000, 103_600_000, -40 * MILLISECOND]))
def test_points_move_by_the_transform_of_their_own_time_to_a_tenth_of_a_millimetre(
    motion, seed, offset_ns
):
    points, to_ns = points_of(seed), START_NS + offset_ns
    azimuth = np.arctan2(points[:, 1].astype(np.float64), points[:, 0].astype(np.float64))
    seen_ns = START_NS + (0.5 - azimuth / (2 * np.pi)) * TURN.length_ns
    (at,) = poses_of(motion, [to_ns])
    homogeneous = np.c_[points[:, :3].astype(np.float64), np.ones(len(points))]
    moved = [
        np.linalg.inv(at) @ pose @ point
        for pose, point in zip(poses_of(motion, seen_ns), homogeneous, strict=True)
    ]
    found = compensate(points, TURN, motion, to_ns)
    assert distances(found, np.array(moved)).max() < 1e-4
    assert (found[:, 3] == points[:, 3]).all()


@given(motions(), seeds, st.sampled_from([0, 51_800_000, 103_600_000]))
def test_undone_and_done_again_all_points_are_where_they_were(motion, seed, offset_ns):
    """Points that stay as far away as undo_compensation needs at 40 m/s."""
    moment_ns = START_NS + offset_ns
    there = compensate(points_of(seed, 500, nearest=8.0), TURN, motion, moment_ns)
    measured = undo_compensation(there, TURN, motion, moment_ns)
    again = compensate(measured, TURN, motion, moment_ns)
    assert distances(again, there).max() < 1e-4


def test_a_point_measured_as_the_turn_begins_is_found_again():
    """Its place at another moment is across straight behind, where the turn ends."""
    still, left, right = (make_twist(np.zeros(3), np.array([0, 0, w])) for w in (0.0, 1.0, -0.5))
    changes = START_NS + np.array([0, 1_000_000, 2_000_000])
    motion = ScannerMotion(changes, np.stack([still, right, still, left]))
    moment_ns = START_NS + 51_800_000
    points = np.array([[-74.597992, 0.0053546168, 0.47673580, 0.8]], np.float32)
    there = compensate(points, TURN, motion, moment_ns)
    assert np.abs(undo_compensation(there, TURN, motion, moment_ns) - points).max() < 1e-4


@given(motions(), seeds)
def test_done_and_undone_points_are_where_they_were_except_straight_behind(motion, seed):
    points = points_of(seed, 500, nearest=8.0)
    behind = np.abs(turned(points) - 0.5) > 0.4
    there = compensate(points, TURN, motion, FORWARD_NS)
    back = undo_compensation(there, TURN, motion, FORWARD_NS)
    assert distances(back, points)[~behind].max() < 1e-4


@given(st.floats(0, 15), st.floats(-0.6, 0.6), seeds)
def test_close_points_converge_at_the_speed_of_a_town(speed, rate, seed):
    twist = make_twist(np.array([speed, 0, 0]), np.array([0, 0, rate]))
    motion = ScannerMotion.from_twists([START_NS], twist[None])
    there = compensate(points_of(seed, 300, nearest=2.0, farthest=6.0), TURN, motion, FORWARD_NS)
    measured = undo_compensation(there, TURN, motion, FORWARD_NS)
    assert distances(compensate(measured, TURN, motion, FORWARD_NS), there).max() < 1e-5


def test_points_on_the_left_were_seen_first():
    driving = ScannerMotion.from_twists(
        [START_NS], make_twist(np.array([10.0, 0, 0]), np.zeros(3))[None]
    )
    left, right = np.array([[0, 5, 0, 0.1], [0, -5, 0, 0.2]], np.float32)
    moved = compensate(np.stack([left, right]), TURN, driving, FORWARD_NS)
    quarter_m = 10.0 * 0.1036 / 4
    assert np.allclose(moved[:, 0], [-quarter_m, quarter_m], atol=1e-6)
    assert np.allclose(moved[:, 1], [5, -5])


def test_at_rest_nothing_changes():
    rest = ScannerMotion.from_twists([START_NS], np.zeros((1, 4, 4)))
    points = points_of(0, 1000)
    assert (compensate(points, TURN, rest, START_NS) == points).all()
    assert (undo_compensation(points, TURN, rest, START_NS) == points).all()


def test_points_without_a_place_remain_and_are_not_warned_of():
    motion = ScannerMotion.from_twists(
        [START_NS], make_twist(np.array([10.0, 1, 0]), np.array([0, 0, 1.0]))[None]
    )
    none, far = [np.nan, np.nan, np.nan, 0.5], [np.inf, 0, 0, 0.5]
    points = np.array([none, far, [0, 0, 0, 0], [7, 1, 0, 1]], np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for change in (compensate, undo_compensation):
            changed = change(points, TURN, motion, FORWARD_NS)
            assert changed.shape == points.shape
            assert np.isnan(changed[0, :3]).all()
            assert not np.isfinite(changed[1, 0])
            assert np.isfinite(changed[2:]).all()
    empty = np.zeros((0, 4), np.float32)
    assert compensate(empty, TURN, motion, START_NS).shape == (0, 4)
    assert undo_compensation(empty, TURN, motion, START_NS).shape == (0, 4)


def test_a_rate_of_turn_that_changes_is_followed_to_millimetres():
    alpha = 0.5
    moments = [START_NS + offset * MILLISECOND for offset in (0, 100)]
    measured = [make_twist(np.zeros(3), np.array([0, 0, alpha * s])) for s in (0.0, 0.1)]
    motion = ScannerMotion.from_twists(moments, np.stack(measured))
    for milliseconds in range(0, 101, 5):
        found = motion.relative(START_NS, START_NS + milliseconds * MILLISECOND)
        yaw = np.arctan2(found[1, 0], found[0, 0])
        assert abs(yaw - alpha * (milliseconds / 1000) ** 2 / 2) * 120 < 0.007


def test_motion_of_poses_is_a_screw():
    arc = make_twist(np.array([15.0, 0, 0]), np.array([0, 0, np.radians(30)]))
    stamps_ns = [START_NS + offset * MILLISECOND for offset in (0, 100, 180)]
    poses = [Transform.from_matrix(exponential(arc * s)) for s in (0, 0.1, 0.18)]
    motion = ScannerMotion.from_poses(stamps_ns, poses)
    assert np.allclose(motion.twists, arc, atol=1e-9)
    halfway = motion.relative(START_NS, START_NS + 50 * MILLISECOND)
    assert np.allclose(halfway, exponential(arc * 0.05), atol=1e-9)
    chord_m = poses[1].translation / 2 - halfway[:3, 3]
    assert 0.009 < np.linalg.norm(chord_m) < 0.011  # what a straight line would be off by


@given(twists, seeds)
def test_points_of_one_moment_move_together(twist, seed):
    points, transform = points_of(seed), exponential(twist)
    expected = points[:, :3] @ transform[:3, :3].T + transform[:3, 3]
    moved = move_rigidly(points, transform)
    assert distances(moved, expected).max() < 1e-4
    assert (moved[:, 3] == points[:, 3]).all()
