# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans on KITTI's grid, moved as KITTI did, and taken back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from moved_scans import TWISTS, moved, street

from kitti_ros2.kitti.scan_grid import (
    KITTI_SHARE,
    compensated,
    find_measured,
    grid_share,
    measured,
    snap,
)

REAL = Path(__file__).parents[3] / 'shared/kitti'


@pytest.mark.parametrize('name', TWISTS)
def test_a_scan_comes_back_to_the_grid_without_poses(name):
    points = street(1)
    file = moved(points, TWISTS[name])
    found = find_measured(file)
    assert found is not None
    assert found.share >= KITTI_SHARE
    assert np.abs(found.twist - TWISTS[name]).max() < 1e-6
    assert (found.xyz == points).all(axis=1).mean() > 0.999
    assert (moved(found.xyz, found.twist) == file).all(axis=1).mean() > 0.99


def test_points_on_the_axis_of_the_scanner_stay():
    """They have no azimuth, which would tell when they were measured; others find the twist."""
    file = moved(street(1), TWISTS['left bend'])
    file[::500] = 0
    file[1::500, :2] = 0
    found = find_measured(file)
    assert found is not None
    for first in (0, 1):
        np.testing.assert_array_equal(found.xyz[first::500, :2], 0)
    assert (found.xyz[2::500] == street(1)[2::500]).all(axis=1).mean() > 0.999


def test_a_start_far_off_does_no_harm():
    file = moved(street(2), TWISTS['straight'])
    near = find_measured(file, np.array(TWISTS['straight']))
    far = find_measured(file, np.array([30.0, 0, 0, 0, 0, 1]))
    assert near is not None
    assert far is not None
    assert np.abs(near.twist - far.twist).max() < 1e-7
    assert (near.xyz == far.xyz).all()


@pytest.mark.parametrize(
    'points',
    [
        np.empty((0, 3), np.float32),
        np.full((5, 3), np.nan, np.float32),
        np.zeros((100, 3), np.float32) + np.float32(0.0123456),
        np.random.default_rng(3).normal(scale=20, size=(20_000, 3)).astype(np.float32),
        street(4) + np.float32(0.0004),
    ],
    ids=['empty', 'NaN', 'one place', 'noise', 'off the grid'],
)
def test_other_scans_are_not_taken_for_kittis(points):
    assert find_measured(points) is None


def test_nan_and_far_points_stay():
    points = street(5)
    file = moved(points, TWISTS['left bend'])
    file[::1000] = np.nan
    found = find_measured(file)
    assert found is not None
    assert np.isnan(found.xyz[::1000]).all()


def test_undoing_is_the_inverse():
    points, twist = street(6).astype(np.float64), np.array(TWISTS['left bend'])
    assert np.abs(measured(compensated(points, twist), twist) - points).max() < 1e-5


@pytest.mark.skipif(not REAL.is_dir(), reason='no real KITTI files')
def test_real_scans_of_odometry_come_back():
    files = sorted(REAL.glob('odometry/dataset/sequences/*/velodyne/*.bin'))
    files += sorted(REAL.glob('semantickitti/*/velodyne/*.bin'))
    assert files
    for path in files:
        file = np.fromfile(path, np.float32).reshape(-1, 4)
        assert grid_share(file[:, :3]) < 0.01
        found = find_measured(file)
        assert found is not None
        assert found.share > 0.9997
        assert (moved(found.xyz, found.twist) == file[:, :3]).all(axis=1).mean() > 0.997


def scan(seed, count=3000):
    """(N, 4) float32 on the grid, with both zeros."""
    random = np.random.default_rng(seed)
    xyz = street(seed)[:count]
    xyz[:4] = [[0.0, -0.0, 1.0], [5.0, 0.0, -0.0], [-0.0, 3.0, -1.0], [2.0, 2.0, 0.0]]
    return np.column_stack([xyz, (random.integers(0, 100, count) / 100).astype(np.float32)])


def test_what_is_on_the_grid_stays_to_the_bit():
    points = scan(1)
    snapped = snap(points)
    assert not snapped.differs(points)
    assert (snapped.off, snapped.reflectance) == (0, True)


def noisy(points):
    random = np.random.default_rng(7)
    noise = random.uniform(-1, 1, points.shape) * [1e-5, 1e-5, 1e-5, 5e-4]
    return (points + noise).astype(np.float32)


def in_another_frame_and_back(points):
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    moved = (points[:, :3].astype(np.float64) @ turn + [1.3, -0.2, 1.7]).astype(np.float32)
    back = (moved.astype(np.float64) - [1.3, -0.2, 1.7]) @ turn.T
    return np.column_stack([back, points[:, 3]]).astype(np.float32)


def of_a_codec_of_1_mm(points):
    xyz = np.rint(points[:, :3].astype(np.float64) * 1000).astype(np.float32) * np.float32(1e-3)
    return np.column_stack([xyz, np.rint(points[:, 3] * 1000).astype(np.float32) * 1e-3]).astype(
        np.float32
    )


@pytest.mark.parametrize('through', [noisy, in_another_frame_and_back, of_a_codec_of_1_mm])
def test_what_went_through_other_programs_comes_back(through):
    points = scan(2)
    there = through(points)
    assert (there != points).any()
    assert (snap(there).points == points).all()  # 0.0 == -0.0: a sign may be another
    assert np.array_equal(snap(snap(there).points).points, points)


@pytest.mark.parametrize('off_m', [7e-4, 4e-5, np.inf])
def test_other_scans_are_on_no_grid(off_m):
    points = scan(4)
    parts = np.random.default_rng(5).uniform(0.5, 1, (len(points), 3))
    points[:, :3] += (parts * off_m).astype(np.float32)
    with np.errstate(all='raise'):
        assert snap(points) is None


@pytest.mark.parametrize('step_mm', [2, 5, 10, 50])
def test_scans_of_a_coarser_codec_stay(step_mm):
    """pymcap-cli rounds to 1 cm unless told otherwise, which is a part of the grid."""
    points = scan(8)
    rounded = np.rint(points[:, :3].astype(np.float64) * 1000 / step_mm) * step_mm
    points[:, :3] = rounded.astype(np.float32) * np.float32(1e-3)
    assert grid_share(points[:, :3]) == 1
    assert snap(points) is None


def test_the_few_points_off_the_grid_and_other_reflectances_stay():
    points = scan(6)
    points[::150, 0] += np.float32(4e-4)
    points[:, 3] = np.random.default_rng(6).integers(0, 255, len(points)) / np.float32(255)
    points[1::150, 1] += np.float32(9e-6)
    snapped = snap(points)
    assert snapped.off == len(points[::150])
    assert not snapped.reflectance
    assert np.array_equal(snapped.points[:, 3], points[:, 3])
    assert np.array_equal(snapped.points[::150], points[::150])
    assert (snapped.points != points).any(axis=1).sum() <= len(points[1::150])
    points[::50, 2] += np.float32(4e-4)
    assert snap(points) is None


def test_no_points_are_on_no_grid():
    assert snap(np.zeros((0, 4), np.float32)) is None
