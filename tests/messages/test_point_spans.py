# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The times of a turn's first and last point, whatever the field, its type and its unit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from kitti_ros2.messages.cdr import make_header
from kitti_ros2.messages.clouds import TurnTimes, point_span_ns
from kitti_ros2.messages.ros_types import PointCloud2, PointField

STAMP_NS = 1_760_000_000_250_000_000
KINDS = {'<f4': 7, '<f8': 8, '<u4': 6, '<u2': 4, '<i4': 5}


def cloud(name, kind, times, places=None):
    """A cloud with a time for each point, in a field of a name and type."""
    points = np.zeros(len(times), [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), (name, kind)])
    points['x'] = 5 if places is None else places
    points[name] = times
    fields = [
        PointField(each, offset, KINDS[field.str], 1)
        for each, (field, offset) in points.dtype.fields.items()
    ]
    step = points.dtype.itemsize
    data = np.frombuffer(points.tobytes(), np.uint8)
    header = make_header(STAMP_NS, 'lidar')
    return PointCloud2(
        header, 1, len(times), fields, False, step, step * len(times), data, is_dense=True
    )


TURN = np.linspace(0, 0.1, 50)
DRIVERS = {
    'Ouster': ('t', '<u4', TURN * 1e9, (0, 100_000_000)),
    'Velodyne, stamped at the end': ('time', '<f4', TURN - 0.1, (-100_000_000, 0)),
    'Hesai': ('timestamp', '<f8', STAMP_NS / 1e9 + TURN, (0, 100_000_000)),
    'Livox of PointCloud2': ('timestamp', '<f8', STAMP_NS + TURN * 1e9, (0, 100_000_000)),
    'Autoware': ('time_stamp', '<u4', TURN * 1e9, (0, 100_000_000)),
    'microseconds': ('t', '<u4', TURN * 1e6, (0, 100_000_000)),
    'milliseconds': ('t', '<f4', TURN * 1e3, (0, 100_000_000)),
    'Argoverse 2': ('offset_ns', '<i4', (TURN - 0.05) * 1e9, (-50_000_000, 50_000_000)),
    '20 Hz': ('t', '<u4', TURN * 0.5e9, (0, 50_000_000)),
}


@pytest.mark.parametrize('driver', DRIVERS)
def test_the_span_is_that_of_the_turn(driver):
    name, kind, times, expected = DRIVERS[driver]
    assert point_span_ns(cloud(name, kind, times)) == pytest.approx(expected, abs=1_000)


def test_times_of_points_that_are_no_returns_do_not_count():
    times = np.concatenate([[0.0, 0.0], STAMP_NS / 1e9 + TURN])
    places = np.concatenate([[0, np.nan], np.full(len(TURN), 4)])
    found = point_span_ns(cloud('timestamp', '<f8', times, places))
    assert found == pytest.approx((0, 100_000_000), abs=1_000)


NO_TURNS = {
    'no field': ('ring', '<u2', np.arange(50)),
    'all zero': ('t', '<u4', np.zeros(50)),
    'not finite': ('time', '<f4', np.full(50, np.nan)),
    'another epoch': ('timestamp', '<f8', 812.0 + TURN),
    'half a second': ('time', '<f4', TURN * 5),
    'one point': ('t', '<u4', np.array([100_000_000])),
    'no point': ('t', '<u4', np.zeros(0)),
}


@pytest.mark.parametrize('name', NO_TURNS)
def test_other_values_are_no_turn(name):
    assert point_span_ns(cloud(*NO_TURNS[name])) is None
    assert TurnTimes().span_ns(cloud(*NO_TURNS[name])) is None


def test_parts_of_a_turn_and_several_have_their_times_once_the_unit_is_known():
    """No span alone tells whether 3,000,000 are nanoseconds, or what of a message 0.5 s are."""
    times = TurnTimes()
    shares = (0.03, 1.0, 0.6, 0.03, 3.9, 5.0, 20.0)
    found = [times.span_ns(cloud('t', '<u4', TURN * 1e9 * share)) for share in shares]
    assert found[0] is found[-1] is None
    ends = [round(share * 100_000_000) for share in shares[1:-1]]
    assert [span[1] for span in found[1:-1]] == pytest.approx(ends, abs=1_000)


RAYS = {
    'a turn': (0.13 / 400, (0, 130_000_000)),
    'two turns': (0.26 / 400, (0, 260_000_000)),
    'three slow turns': (0.6 / 400, (0, 600_000_000)),
    'a fast one': (0.012 / 400, (0, 12_000_000)),
    'backwards': (-0.1 / 400, (-100_000_000, 0)),
    'all at once': (0.0, None),
    'of a float': (1e-9, None),
    'too slow': (0.01, None),
    'not a number': (float('nan'), None),
}


@pytest.mark.parametrize('name', RAYS)
def test_each_ring_has_the_time_of_its_own_rays(name):
    increment, expected = RAYS[name]
    message = SimpleNamespace(time_increment=increment, ranges=[1.0] * 401)
    assert TurnTimes().span_ns(message) == pytest.approx(expected, abs=1)


@pytest.mark.parametrize(
    'parts',
    [
        {},
        {'points': []},  # a CustomMsg without a timebase
        {'timebase': 0, 'points': [SimpleNamespace(x=1.0, y=0.0, z=0.0)]},
        {'packets': [SimpleNamespace(data=b'')]},
        {'time_increment': 'text', 'ranges': [1.0]},
        {'time_increment': 0.1, 'ranges': 3},
    ],
)
def test_definitions_without_times_or_with_others_tell_no_turn(parts):
    assert (
        TurnTimes().span_ns(SimpleNamespace(header=make_header(STAMP_NS, 'lidar'), **parts)) is None
    )
