# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The time of each point within its scan, and the order of points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.messages.cdr import deserialize, join, serialize
from kitti_ros2.messages.clouds import decode_cloud
from kitti_ros2.messages.scan import PointValues, decode_scan, encode_scan, rings
from kitti_ros2.model.bag_formats import Points
from kitti_ros2.model.samples import Scan, Turn

if TYPE_CHECKING:
    from pathlib import Path

STAMP = 1317042272283701593
LENGTH = 103_272_338
TURN = Turn(STAMP, LENGTH)
FORWARD_NS = 51_636_169
TIMED = ['x', 'y', 'z', 'intensity', 'ring', 'time', 'file_index']

POINTS = arrays.arrays(
    np.float32,
    st.integers(0, 40).map(lambda n: (n, 4)),
    # Few values give ties; the rest is anything that a float can be.
    elements=st.sampled_from([0.0, -0.0, 1.0, -1.0]) | st.floats(width=32),
)


def through_cdr(message):
    return deserialize(join(serialize(message)), message.__msgtype__)


def fields_of(message) -> dict[str, np.ndarray]:
    """The fields of a cloud by the offsets and types in the message, nothing assumed."""
    kinds = {4: np.uint16, 6: np.uint32, 7: np.float32}
    shape = (message.width, message.point_step)
    rows = np.frombuffer(message.data.tobytes(), np.uint8).reshape(shape)
    found = {}
    for field in message.fields:
        kind = np.dtype(kinds[field.datatype])
        part = rows[:, field.offset : field.offset + kind.itemsize]
        found[field.name] = np.ascontiguousarray(part).view(kind).reshape(-1)
    return found


def test_two_lasers_in_order_of_time():
    """Each is in the file counter-clockwise from ahead; the turn is clockwise from behind."""
    azimuths = np.radians([1, 90, 179, -179, -90, -1, 1, 90, 179, -179, -90, -1])
    points = np.zeros((12, 4), np.float32)
    points[:, 0], points[:, 1], points[:, 3] = np.cos(azimuths), np.sin(azimuths), np.arange(12)
    assert rings(points).tolist() == [1] * 6 + [0] * 6
    scan = Scan(points, turn=Turn(STAMP, 100_000_000))
    message = through_cdr(encode_scan(scan, STAMP, 'velo_link', points=Points.XYZIRT))
    cloud = fields_of(message)
    assert list(cloud) == TIMED
    assert message.point_step == 26
    expected = [0.0003, 0.0003, 0.025, 0.025, 0.0497, 0.0497, 0.0503, 0.0503, 0.075, 0.075]
    np.testing.assert_allclose(cloud['time'], [*expected, 0.0997, 0.0997], atol=1e-4)
    assert cloud['file_index'].tolist() == [2, 8, 1, 7, 0, 6, 5, 11, 4, 10, 3, 9]
    assert cloud['ring'].tolist() == [1, 0] * 6
    assert cloud['intensity'].tolist() == cloud['file_index'].tolist()
    assert decode_scan(message).points.tobytes() == points.tobytes()


def test_a_scan_without_a_turn_has_ring_and_no_time():
    points = np.random.default_rng(0).random((50, 4), np.float32)
    message = encode_scan(Scan(points), STAMP, 'velo_link', points=Points.XYZIRT)
    cloud = fields_of(message)
    assert list(cloud) == TIMED[:5]
    assert np.column_stack([cloud[name] for name in TIMED[:4]]).tobytes() == points.tobytes()


@given(
    POINTS,
    st.data(),
    st.integers(1, 10**9),
    st.integers(-(10**9), 10**9),
    st.booleans(),
)
def test_any_points_are_in_order_of_time_and_come_back(points, data, length, offset, labelled):
    labels = None
    if labelled:
        values = st.integers(0, 2**32 - 1)
        labels = data.draw(arrays.arrays(np.uint32, len(points), elements=values))
    scan = Scan(points, turn=Turn(STAMP + offset, length))
    encoded = encode_scan(scan, STAMP, 'velo_link', points=Points.XYZIRT, labels=labels)
    message = through_cdr(encoded)
    cloud = fields_of(message)
    time, places = cloud['time'], cloud['file_index']
    assert (np.diff(time) >= 0).all()
    assert np.all(time >= np.float32(offset / 1e9))
    assert np.all(time <= np.float32((offset + length) / 1e9))
    assert sorted(places.tolist()) == list(range(len(points)))
    # Every field went with its point.
    moved = np.column_stack([cloud[name] for name in TIMED[:4]])
    assert moved.tobytes() == points[places].tobytes()
    assert cloud['ring'].tolist() == rings(points)[places].tolist()
    assert decode_scan(message).points.tobytes() == points.tobytes()
    if labels is not None:
        assert decode_scan(message).labels.tolist() == labels.tolist()


@given(POINTS)
def test_importers_of_any_cloud_see_the_file_s_order(points):
    points = np.clip(np.nan_to_num(points), -100, 100)
    points[:, 3] = np.abs(points[:, 3]) / 100
    message = encode_scan(Scan(points, turn=TURN), STAMP, 'velo_link', points=Points.XYZIRT)
    assert decode_cloud(message)[0].tobytes() == points.tobytes()


def test_an_order_that_is_none_is_refused():
    points = np.random.default_rng(1).random((5, 4), np.float32)
    message = encode_scan(Scan(points, turn=TURN), STAMP, 'velo_link', points=Points.XYZIRT)
    data = message.data.reshape(5, 26)
    for wrong in (7, 2**32 - 1, int(data[0, 22:].view('<u4')[0])):
        data[4, 22:].view('<u4')[:] = wrong
        with pytest.raises(ValueError, match='file_index does not give each place once'):
            decode_scan(message)
        assert len(decode_cloud(message)[0]) == 5
    message.fields[-1].datatype = 7  # float32
    with pytest.raises(ValueError, match='or with other types or offsets'):
        decode_scan(message)
    assert len(decode_cloud(message)[0]) == 5


@pytest.mark.parametrize('speed', [[14.0, 0.0, 0.0], [9.0, 3.0, 0.5]])
def test_times_undo_the_motion_of_a_car_under_a_clockwise_scanner(speed):
    """A scanner that is turned step by step, clockwise, on a car that drives past fixed points."""
    rng = np.random.default_rng(2)
    speed = np.array(speed)
    fixed = np.column_stack([rng.uniform(-60, 60, (2000, 2)), rng.uniform(-2, 2, 2000)])
    fixed = fixed[np.hypot(*fixed[:, :2].T) > 8]
    seen, seen_at = [], []
    for point in fixed:
        # In steps of 1.8 degrees, and in steps of 0.009 degrees within the one that hits.
        moments = np.linspace(0.0, LENGTH / 1e9, 201)
        for _ in range(2):
            heading = np.pi - 2 * np.pi * moments / (LENGTH / 1e9)  # from behind, clockwise
            relative = point - speed * (moments - FORWARD_NS / 1e9)[:, None]
            miss = np.arctan2(relative[:, 1], relative[:, 0]) - heading
            miss = np.angle(np.exp(1j * miss))
            [hits] = np.nonzero((np.abs(np.diff(miss)) < 1) & (miss[:-1] < 0) & (miss[1:] >= 0))
            if not len(hits):
                break
            first = relative[hits[0]], moments[hits[0]]
            moments = np.linspace(moments[hits[0]], moments[hits[0] + 1], 201)
        else:
            seen.append(first[0])
            seen_at.append(first[1])
    assert len(seen) > 0.9 * len(fixed)
    points = np.column_stack([seen, np.zeros(len(seen))]).astype(np.float32)
    found = PointValues(points, TURN, STAMP).seconds
    np.testing.assert_allclose(found, seen_at, atol=1e-5)
    # The same absolute time by the other stamp.
    later = PointValues(points, TURN, STAMP + FORWARD_NS).seconds
    np.testing.assert_allclose(found - FORWARD_NS / 1e9, later, atol=1e-7)


# The proof on KITTI's own files: a laser keeps its angle, so its points lie on a line in distance
# and height, z = T rho + D, as long as they are as measured. Compensation for motion breaks the
# lines, and moving the points back restores them, in one direction of turning only.


def load(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The points, and the laser of each: it begins where the azimuth wraps from 2 pi to 0."""
    points = np.fromfile(path, '<f4').reshape(-1, 4).astype(np.float64)
    azimuth = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    return points, np.concatenate([[0], np.cumsum(np.diff(azimuth) < -np.pi)])


def line_error(points: np.ndarray, laser: np.ndarray, metres: float) -> float:
    """Degrees off the line of their laser, median, after x is moved by metres azimuth / 2 pi."""
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    distance = np.hypot(points[:, 0] + metres * azimuth / (2 * np.pi), points[:, 1])
    errors = []
    for one in range(laser[-1] + 1):
        rho, z = distance[laser == one], points[laser == one, 2]
        near = rho > 3
        terms = np.column_stack([np.ones(near.sum()), 1 / rho[near]])
        target = z[near] / rho[near]
        line = np.linalg.lstsq(terms, target, rcond=None)[0]
        errors.append(np.median(np.abs(target - terms @ line)))
    return float(np.degrees(np.median(errors)))


def test_scans_that_are_not_compensated_keep_their_lines(real_kitti):
    raw = real_kitti / 'raw/2011_09_26'
    for path in (
        raw / '2011_09_26_drive_0005_sync/velodyne_points/data/0000000000.bin',
        raw / '2011_09_26_drive_0052_sync/velodyne_points/data/0000000003.bin',
        real_kitti / 'object/training/velodyne/000002.bin',
    ):
        scan = load(path)
        assert line_error(*scan, 0.0) < 0.0025
        assert line_error(*scan, 0.8) > 0.05
        assert line_error(*scan, -0.8) > 0.05


@pytest.mark.parametrize('frame', [0, 1])
def test_odometry_scans_are_compensated_for_a_clockwise_turn(real_kitti, frame):
    dataset = real_kitti / 'odometry' / 'dataset'
    compensated, laser = load(dataset / f'sequences/00/velodyne/{frame:06d}.bin')
    poses = np.loadtxt(dataset / 'poses' / '00.txt').reshape(-1, 3, 4)
    stamps = np.loadtxt(dataset / 'sequences/00/times.txt')
    driven = float(np.linalg.norm(poses[frame + 1, :, 3] - poses[frame, :, 3]))
    assert driven == pytest.approx(0.86, abs=0.005)
    as_it_is = line_error(compensated, laser, 0.0)
    assert line_error(compensated, laser, driven) < as_it_is / 4
    assert line_error(compensated, laser, -driven) > as_it_is * 1.5
    # Back to the measured points by that direction, and forth by the times that clouds have.
    azimuth = np.arctan2(compensated[:, 1], compensated[:, 0])
    measured = compensated.copy()
    measured[:, 0] += driven * azimuth / (2 * np.pi)
    length = stamps[frame + 1] - stamps[frame]
    turn = Turn(STAMP, round(length * 1e9))
    since = PointValues(measured.astype(np.float32), turn, STAMP).seconds.astype(np.float64)
    again = measured[:, 0] + driven / length * (since - length / 2)
    assert np.abs(again - compensated[:, 0]).mean() < 0.005
    backwards = measured[:, 0] - driven / length * (since - length / 2)
    assert np.abs(backwards - compensated[:, 0]).mean() == pytest.approx(0.42, abs=0.02)
