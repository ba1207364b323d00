# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The unit at 100 Hz and the turning scanner: exact on the path, as irregular as KITTI's."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import rotation_from_rpy, rotation_to_rpy
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions, write_synthetic
from kitti_ros2.synthetic.scene import GRAVITY, Course, packet_of
from kitti_ros2.synthetic.sensors import PERIOD_NS, list_arrivals

FAST = SyntheticOptions(
    frames=30, image_size=(16, 16), lidar_columns=64, speed=15.0, turn_rate=30.0, extract=True
)
PERIOD_S = PERIOD_NS / 1e9


@pytest.fixture(scope='module')
def drive():
    return SyntheticDrive(FAST)


@pytest.fixture(scope='module')
def packets(drive):
    """One second of packets without a gap, from a moment in a bend: times and samples."""
    times = np.arange(100, 201) * PERIOD_NS + int(drive.arrivals.times_ns.min())
    return [packet_of(drive.motion_at(int(time))) for time in times.tolist()]


def turned(rotation, rate, seconds):
    """A rotation after a constant rate in body axes, by Rodrigues' formula."""
    angle = np.linalg.norm(rate) * seconds
    x, y, z = rate / np.linalg.norm(rate)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return rotation @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def metres(packet, first):
    """East, north and up from the first packet."""
    scale = np.cos(np.radians(49.0093)) * 6378137.0
    east = scale * np.radians(packet.lon - first.lon)
    mercator = [np.arctanh(np.sin(np.radians(each.lat))) for each in (packet, first)]
    return np.array([east, scale * (mercator[0] - mercator[1]), packet.alt - first.alt])


def test_integrating_the_imu_for_a_second_gives_the_pose(packets):
    first, last = packets[0], packets[-1]
    rotation = rotation_from_rpy(first.roll, first.pitch, first.yaw)
    velocity, position = np.array([first.ve, first.vn, first.vu]), np.zeros(3)
    gravity = np.array([0, 0, GRAVITY])
    for now, then in pairwise(packets):
        rate = np.mean([[each.wx, each.wy, each.wz] for each in (now, then)], axis=0)
        after = turned(rotation, rate, PERIOD_S)
        felt = rotation @ [now.ax, now.ay, now.az], after @ [then.ax, then.ay, then.az]
        acceleration = (felt[0] + felt[1]) / 2 - gravity
        position += velocity * PERIOD_S + acceleration * PERIOD_S**2 / 2
        velocity = velocity + acceleration * PERIOD_S
        rotation = after
    np.testing.assert_allclose(velocity, [last.ve, last.vn, last.vu], atol=2e-3)
    np.testing.assert_allclose(position, metres(last, first), atol=2e-3)
    np.testing.assert_allclose(
        rotation_to_rpy(rotation), [last.roll, last.pitch, last.yaw], atol=1e-4
    )
    assert np.linalg.norm(position) > 14


def test_the_car_drives_and_turns_as_fast_as_asked(drive):
    found = [drive.arrived(number) for number in range(0, len(drive.arrivals.times_ns), 3)]
    assert np.mean([np.hypot(each.ve, each.vn) for each in found]) == pytest.approx(15.7, abs=0.7)
    assert max(abs(each.wz) for each in found) == pytest.approx(np.radians(30), rel=0.04)


def test_a_course_of_a_turn_rate_keeps_the_default_one():
    assert SyntheticOptions().course == Course()
    assert SyntheticOptions(speed=20).course.wave_number == Course().wave_number


@pytest.mark.parametrize('seed', range(4))
def test_packets_arrive_as_in_kitti(seed):
    arrivals = list_arrivals(seed, 0, 40_000_000_000)
    steps = np.diff(arrivals.stamps_ns)
    back = np.flatnonzero(steps < 0)
    assert len(back) >= 20
    assert np.median(steps[back]) == pytest.approx(-5 * PERIOD_NS, rel=0.01)
    for at in back.tolist():
        again = arrivals.stamps_ns[at + 1 : at + 7]
        assert {*again.tolist()} <= {*arrivals.stamps_ns[: at + 1].tolist()}
    once = np.unique(arrivals.stamps_ns)
    intervals = np.diff(once)
    assert (intervals > 0).all()
    low, high = np.percentile(intervals, [25, 75])
    assert low == pytest.approx(PERIOD_NS, rel=0.005)
    assert high == pytest.approx(PERIOD_NS, rel=0.005)
    assert 2 <= (intervals > 1.5 * PERIOD_NS).sum() <= 6
    assert once[0] < -400_000_000
    assert once[-1] > 40_400_000_000


def test_the_same_options_give_the_same_packets(drive):
    again = SyntheticDrive(FAST)
    np.testing.assert_array_equal(again.arrivals.stamps_ns, drive.arrivals.stamps_ns)
    assert again.arrived(77) == drive.arrived(77)


def test_packets_of_frames_are_some_of_the_extract(drive):
    for frame in (0, 7, 29):
        number = drive.arrivals.stamps_ns.tolist().index(drive.packet_stamp(frame))
        assert drive.packet(frame) == drive.arrived(number)
        assert abs(drive.packet_stamp(frame) - drive.stamps(frame).scan) < 150_000_000


def test_a_swept_scan_is_a_snapshot_after_compensation(tmp_path):
    """Undone by the package's own compensation, which knows the packets alone."""
    options = replace(FAST, frames=4, swept=True, extract=False)
    path = write_synthetic(tmp_path / 'swept', Layout.RAW, options)
    still = SyntheticDrive(replace(options, swept=False))
    raw, even = (open_recording(path, ReadOptions(deskew=on)) for on in (False, True))
    snapshot = still.scan(2).points
    moved, compensated = (each.read(Stream.SCAN, 2).points for each in (raw, even))
    assert len(moved) == len(compensated) > 0.98 * len(snapshot)
    near = nearest(compensated, snapshot)
    far = nearest(moved, snapshot)
    assert np.percentile(near, 95) < 0.05
    assert np.percentile(far, 50) > 5 * np.percentile(near, 50)


def nearest(points, others):
    """Distance of each point to the nearest of others, metres."""
    return np.array(
        [np.linalg.norm(others[:, :3] - each, axis=1).min() for each in points[::7, :3]]
    )


def test_only_raw_drives_have_an_extract(tmp_path):
    with pytest.raises(UsageError, match='layout object has no unsynchronised drives'):
        write_synthetic(tmp_path / 'x', Layout.OBJECT, FAST)
    assert not (tmp_path / 'x').exists()


@pytest.mark.parametrize(
    'wrong', [{'speed': 0.0}, {'turn_rate': 0.0}, {'turn_rate': 90.0}, {'rest': -1.0}]
)
def test_impossible_courses_are_refused(wrong):
    with pytest.raises(UsageError, match=next(iter(wrong))):
        SyntheticOptions(**wrong)
