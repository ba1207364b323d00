# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans rounded to KITTI's grid, and made again of the rounded points to the bit."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from moved_scans import TWISTS, moved, street

from kitti_ros2.kitti.compact_scan import LARGEST, compact, restore
from kitti_ros2.model.samples import MISSING, Exceptions, GridSteps, ScanRest

REAL = Path(__file__).parents[3] / 'shared/kitti'
STEPS = np.array([0.001, 0.001, 0.001, 0.01], np.float32)
ODD = np.array(
    [0.0, -0.0, np.nan, -np.nan, np.inf, -np.inf, 1e-45, -1e-45, 1e-38, 3e38, 0.0005, 2097.151],
    np.float32,
)
PAYLOAD = np.array([0x7FC00001, 0xFFFFFFFF, 0x7F800001], np.uint32).view(np.float32)


def scan_on_grid(count, seed=0):
    random = np.random.default_rng(seed)
    millimetres = random.integers(-90_000, 90_000, (count, 3))
    return np.column_stack([millimetres / 1000, random.integers(0, 100, count) / 100]).astype('<f4')


def received(scan):
    """The points as decoders of Cloudini return them."""
    points = scan.multiples.astype(np.float32) * STEPS
    points[scan.multiples == MISSING] = np.nan
    return points


def assert_same(points):
    scan = compact(points)
    given_points = points if scan.multiples is None else received(scan)
    for each in (given_points, points):
        assert restore(each, scan.rest).tobytes() == points.tobytes()
    return scan


MOSTLY_ON_GRID = st.builds(
    lambda count, places, values: np.put(points := scan_on_grid(count), places, values) or points,
    st.integers(100, 300),
    st.lists(st.integers(0, 399), min_size=1, max_size=15),
    st.lists(st.sampled_from([*ODD, *PAYLOAD]) | st.floats(width=32), min_size=15, max_size=15),
)


@given(st_numpy.arrays('<f4', st.tuples(st.integers(0, 20), st.just(4))) | MOSTLY_ON_GRID)
def test_any_scan_comes_back_to_the_bit(points):
    assert_same(points)


def test_on_the_grid_nothing_else_is_stored():
    scan = assert_same(scan_on_grid(40_000))
    assert len(scan.rest.exceptions.indices) == 0
    assert np.abs(received(scan) - scan_on_grid(40_000)).max() < 1e-4


def test_signs_of_zeros_and_missing_values_are_stored():
    points = scan_on_grid(40_000)
    points[::1000, 1] = -0.0
    points[7] = np.nan
    points[8, 0] = PAYLOAD[0]
    scan = assert_same(points)
    assert len(scan.rest.exceptions.indices) == 40 + 4 + 1
    assert np.isnan(received(scan)[7]).all()


@pytest.mark.parametrize('shift', [0.0005, 0.0003], ids=['half', 'third'])
def test_scans_off_the_grid_are_not_rounded(shift):
    points = scan_on_grid(5000)
    points[:, :3] += np.float32(shift)
    assert assert_same(points).multiples is None


@pytest.mark.parametrize('value', [np.inf, LARGEST / 1000, -1e30])
def test_one_value_that_is_too_large_is_not_rounded(value):
    points = scan_on_grid(500)
    points[100, 2] = value
    assert assert_same(points).multiples is None


@pytest.mark.parametrize('name', TWISTS)
def test_compensated_scans_are_those_of_the_grid(name):
    xyz = moved(street(1), TWISTS[name])
    points = np.column_stack([xyz, scan_on_grid(len(xyz))[:, 3]])
    scan = assert_same(points)
    assert np.abs(received(scan) - points).max() < 0.000504
    assert (scan.rest.twist is None) is (name == 'standing')
    assert len(scan.rest.exceptions.indices) < 0.01 * points.size


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', TWISTS)
def test_odd_values_among_compensated_ones_come_back_without_a_warning(name):
    """Points on the axis of the scanner, signs of zeros, denormals, NaN and its payloads."""
    random, xyz = np.random.default_rng(3), moved(street(1), TWISTS[name])
    points = np.column_stack([xyz, scan_on_grid(len(xyz))[:, 3]]).astype('<f4')
    small = np.concatenate([ODD[~(np.abs(ODD) > 1000)], PAYLOAD[:2]])
    points.reshape(-1)[random.integers(0, points.size, 400)] = random.choice(small, 400)
    points[random.integers(0, len(points), 50), :2] = 0
    points[random.integers(0, len(points), 50)] = 0
    assert assert_same(points).multiples is not None


def test_other_points_do_not_pass_for_those_of_a_file():
    points = scan_on_grid(500)
    rest = compact(points).rest
    for other in (points[:-1], points[::-1], points + np.float32(0.0015)):
        with pytest.raises(ValueError, match='CRC-32 of the file'):
            restore(other, rest)
    points[499, 3] = -0.0
    with pytest.raises(ValueError, match='fewer'):
        restore(points[:-1], compact(points).rest)
    beyond = GridSteps(np.array([1500], np.uint32), np.ones(1, np.int8))
    with pytest.raises(ValueError, match='fewer'):
        restore(points, rest._replace(twist=np.zeros(6), steps=beyond))


def test_rounded_scans_are_the_same_with_every_numpy():
    points = scan_on_grid(70_000)
    points[::999, 0] = -0.0
    multiples, rest = compact(points)
    digest = hashlib.sha256(multiples.tobytes() + rest.exceptions.indices.tobytes())
    assert digest.hexdigest()[:16] == '7fbd02c4fc63c26c'


def test_compensated_scans_are_the_same_with_every_numpy():
    xyz = street(1)[::7]
    points = np.column_stack([xyz, np.zeros(len(xyz), np.float32)])
    nothing = np.empty(0, np.uint32)
    steps = GridSteps(np.array([5], np.uint32), np.array([-3], np.int8))
    twist = np.array(TWISTS['left bend'])
    restore(points, ScanRest(0x6B994F15, Exceptions(nothing, nothing), twist, steps))


@pytest.mark.skipif(not REAL.is_dir(), reason='needs real KITTI files in ../shared')
@pytest.mark.parametrize('layout', ['object', 'odometry', 'raw', 'semantickitti'])
def test_real_scans_are_on_the_grid(layout):
    paths = sorted(REAL.glob(f'{layout}/**/velodyne*/**/*.bin'))[:4]
    assert paths
    for path in paths:
        scan = assert_same(np.fromfile(path, '<f4').reshape(-1, 4))
        assert len(scan.rest.exceptions.indices) < 0.01 * scan.multiples.size
        assert (scan.rest.twist is None) is (layout in {'object', 'raw'})
