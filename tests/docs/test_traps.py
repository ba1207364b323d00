# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of docs/kitti/traps.md, computed from KITTI's own files, not by the package."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timezone
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from kitti_ros2.kitti.text_file import COLUMNS

if TYPE_CHECKING:
    from pathlib import Path

DRIVES = ('0001', '0005')
SIZES = {'000000': (1224, 370), '000001': (1242, 375), '000002': (1242, 375)}


def drive_of(real_kitti: Path, number: str) -> Path:
    return real_kitti / 'raw' / '2011_09_26' / f'2011_09_26_drive_{number}_sync'


def stamps(path: Path) -> np.ndarray:
    found = []
    for line in path.read_text().splitlines():
        second, fraction = line.split('.')
        at = datetime.fromisoformat(second).replace(tzinfo=timezone.utc)
        found.append(int(at.timestamp()) * 10**9 + int(fraction))
    return np.array(found)


def points_in(path: Path) -> np.ndarray:
    return np.fromfile(path, '<f4').reshape(-1, 4).astype(float)


def numbers_in(path: Path) -> dict[str, np.ndarray]:
    rows = (line.replace(':', ' ').split() for line in path.read_text().splitlines())
    return {row[0]: np.array(row[1:], float) for row in rows if row and row[0] != 'calib_time'}


def packets(real_kitti: Path, number: str) -> dict[str, np.ndarray]:
    files = sorted((drive_of(real_kitti, number) / 'oxts' / 'data').iterdir())
    return dict(zip(COLUMNS, np.array([np.loadtxt(file) for file in files]).T, strict=True))


def wrap(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    (a, b, c), (d, e, f) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    about_y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    return about_z @ about_y @ np.array([[1, 0, 0], [0, a, -d], [0, d, a]])


def pixels(projection: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    seen = places @ projection[:, :3].T + projection[:, 3]
    return seen[:, :2] / seen[:, 2:], seen[:, 2]


@pytest.mark.parametrize(
    ('number', 'period', 'touching'), [('0001', 0.10315, 96), ('0005', 0.10327, 128)]
)
def test_turns(real_kitti, number, period, touching):
    folder = drive_of(real_kitti, number)
    scans = folder / 'velodyne_points'
    forward = stamps(scans / 'timestamps.txt')
    start, end = stamps(scans / 'timestamps_start.txt'), stamps(scans / 'timestamps_end.txt')
    assert ((start + end) // 2 == forward).all()
    assert np.diff(forward).mean() / 1e9 == pytest.approx(period, abs=5e-6)
    assert (end[:-1] == start[1:]).sum() == touching
    late = {
        name: (stamps(folder / name / 'timestamps.txt') - forward) / 1e6
        for name in ('image_00', 'image_01', 'image_02', 'image_03', 'oxts')
    }
    for name, least, most in (('image_02', 9.9, 10.7), ('image_03', 9.4, 10.1), ('oxts', 10, 24)):
        assert least < late[name].min() < late[name].max() < most
    assert all(16 < late[name].min() < late[name].max() < 20.5 for name in ('image_00', 'image_01'))


def laser_line_error(points: np.ndarray, shift: float) -> float:
    """Median distance, degrees, of a laser's points from a line z = T rho + D, after x is moved."""
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    wraps = (azimuth[:-1] < 0) & (azimuth[1:] >= 0) & (azimuth[:-1] - azimuth[1:] > -np.pi)
    ring = np.concatenate([[0], np.cumsum(wraps)])
    rho = np.hypot(points[:, 0] + shift * azimuth / (2 * np.pi), points[:, 1])
    errors = []
    for laser in range(ring.max() + 1):
        mine = (ring == laser) & (rho > 3)
        if mine.sum() >= 300:
            rows = np.column_stack([np.ones(mine.sum()), 1 / rho[mine]])
            slope = points[mine, 2] / rho[mine]
            errors.append(np.median(np.abs(rows @ np.linalg.lstsq(rows, slope)[0] - slope)))
    return float(np.degrees(np.median(errors)))


def test_scans_of_odometry_alone_are_compensated(real_kitti):
    measured = [
        drive_of(real_kitti, '0005') / 'velodyne_points' / 'data' / '0000000000.bin',
        *sorted((real_kitti / 'object' / 'training' / 'velodyne').iterdir()),
    ]
    for path in measured:
        points = points_in(path)
        assert laser_line_error(points, 0) < 0.002
        assert min(laser_line_error(points, 0.85), laser_line_error(points, -0.85)) > 0.05
    scans = real_kitti / 'odometry' / 'dataset' / 'sequences' / '00' / 'velodyne'
    for path in sorted(scans.iterdir()):
        points = points_in(path)
        clockwise, as_is, counter = (laser_line_error(points, s) for s in (0.85, 0, -0.85))
        assert clockwise < 0.015 < 0.08 < as_is < counter


@pytest.mark.parametrize('frame', SIZES)
def test_projection_without_one_of_its_parts(real_kitti, frame):
    folder = real_kitti / 'object' / 'training'
    calib = numbers_in(folder / 'calib' / f'{frame}.txt')
    p2, r0 = calib['P2'].reshape(3, 4), calib['R0_rect'].reshape(3, 3)
    extrinsics = calib['Tr_velo_to_cam'].reshape(3, 4)
    cam0 = points_in(folder / 'velodyne' / f'{frame}.bin')[:, :3] @ extrinsics[:, :3].T
    cam0 += extrinsics[:, 3]
    uv, depth = pixels(p2, cam0 @ r0.T)
    seen = (depth > 0.1) & (uv > 0).all(axis=1) & (uv < SIZES[frame]).all(axis=1)
    without_r0 = np.linalg.norm(pixels(p2, cam0)[0] - uv, axis=1)[seen]
    without_offset = np.linalg.norm(
        pixels(np.column_stack([p2[:, :3], np.zeros(3)]), cam0 @ r0.T)[0] - uv, axis=1
    )[seen]
    assert 6.5 < np.median(without_r0) < 7.4
    assert 3.4 < np.median(without_offset) < 5.3


def iou_of(words: list[str], p2: np.ndarray, size: tuple[int, int], lift: float) -> float:
    left, top, right, bottom, height, width, length, x, y, z, ry = map(float, words[4:15])
    signs = np.array([(a, b, c) for a in (1, -1) for b in (0, 1) for c in (1, -1)])
    along, up, across = (signs * [length / 2, height, width / 2]).T
    corners = np.column_stack(
        [
            x + along * np.cos(ry) + across * np.sin(ry),
            y + lift * height - up,
            z - along * np.sin(ry) + across * np.cos(ry),
        ]
    )
    uv, _ = pixels(p2, corners)
    low, high = uv.min(axis=0).clip(0), np.minimum(uv.max(axis=0), np.array(size) - 1)
    both = np.clip(np.minimum(high, (right, bottom)) - np.maximum(low, (left, top)), 0, None).prod()
    return both / ((high - low).prod() + (right - left) * (bottom - top) - both)


@pytest.mark.parametrize('frame', SIZES)
def test_a_box_stands_on_its_origin(real_kitti, frame):
    folder = real_kitti / 'object' / 'training'
    p2 = numbers_in(folder / 'calib' / f'{frame}.txt')['P2'].reshape(3, 4)
    for line in (folder / 'label_2' / f'{frame}.txt').read_text().splitlines():
        words = line.split()
        if words[0] != 'DontCare':
            assert iou_of(words, p2, SIZES[frame], 0) > 0.88
            assert iou_of(words, p2, SIZES[frame], 0.5) < 0.48


def test_labels_of_tracking(real_kitti):
    path = real_kitti / 'tracking' / 'training' / 'label_02' / '0000.txt'
    rows = [line.split() for line in path.read_text().splitlines()]
    regions = [row for row in rows if row[2] == 'DontCare']
    assert {tuple(map(float, row[10:])) for row in regions} == {(-1000,) * 3 + (-10, -1, -1, -1)}
    objects = [row for row in rows if row[2] != 'DontCare']
    assert (len(rows), len(regions), len(objects)) == (1089, 378, 711)
    assert Counter(row[4] for row in objects)['3'] == 6
    values = np.array([row[3:] for row in objects], float)
    alpha, x, z, ry = values[:, 2], values[:, 10], values[:, 12], values[:, 13]
    assert np.median(np.abs(wrap(ry - np.arctan2(x, z) - alpha))) < 0.005
    assert np.degrees(np.abs(alpha - ry).max()) == pytest.approx(78, abs=0.5)


@pytest.mark.parametrize('number', DRIVES)
def test_packets(real_kitti, number):
    d = packets(real_kitti, number)
    right = d['ve'] * np.sin(d['yaw']) - d['vn'] * np.cos(d['yaw'])
    assert np.abs(d['vl'] - right).max() < 0.08
    assert np.abs(d['vl'] + right).max() > 0.3
    body = np.column_stack([d['ax'], d['ay'], d['az']])
    level = [rotation(*angles, 0) for angles in zip(d['roll'], d['pitch'], strict=True)]
    turned = np.array([each @ row for each, row in zip(level, body, strict=True)])
    assert np.abs(turned - np.column_stack([d['af'], d['al'], d['au']])).max() < 0.06
    east, north = mercator(d)
    moving = np.hypot(np.diff(east), np.diff(north)) > 0.2
    off = wrap(np.arctan2(np.diff(north), np.diff(east)) - d['yaw'][:-1])[moving]
    assert np.abs(np.degrees(np.median(off))) < 0.4


def mercator(d: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    scale = 6378137 * np.cos(np.radians(d['lat'][0]))
    return (
        scale * np.radians(d['lon']),
        scale * np.log(np.tan(np.pi / 4 + np.radians(d['lat']) / 2)),
    )


def test_the_devkit_s_world_is_tilted(real_kitti):
    d = packets(real_kitti, '0001')
    east, north = mercator(d)
    moved = np.array([values[-1] - values[0] for values in (east, north, d['alt'])])
    first = rotation(d['roll'][0], d['pitch'][0], d['yaw'][0])
    assert np.hypot(*moved[:2]) == pytest.approx(106.8, abs=0.1)
    assert (moved[2], (first.T @ moved)[2]) == pytest.approx((0.02, 1.34), abs=0.01)
    assert 1 / np.cos(np.radians(d['lat'][0])) == pytest.approx(1.52, abs=0.005)


def test_odometry_moves_forward_along_z(real_kitti):
    path = real_kitti / 'odometry' / 'dataset' / 'poses' / '00.txt'
    poses = np.loadtxt(path, max_rows=3).reshape(-1, 3, 4)
    for before, after in pairwise(poses):
        step = after[:, 3] - before[:, 3]
        assert np.linalg.norm(step) == pytest.approx(0.86, abs=0.001)
        assert step[2] > 0.85


def turn_vector(matrix: np.ndarray) -> np.ndarray:
    """(3,) axis times angle of a small turn."""
    skew = matrix - matrix.T
    sine = np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) / 2
    return sine * np.arcsin(np.linalg.norm(sine)) / max(np.linalg.norm(sine), 1e-12)


@pytest.mark.parametrize(
    ('number', 'lags', 'as_is', 'shifted', 'at_packets', 'ends'),
    [
        ('0001', (55, 54, 56), 0.44, 0.24, 0.35, 0.25),
        ('0005', (52, 49, 64), 1.04, 0.53, 0.75, 0.50),
    ],
)
def test_rates_of_turn_are_late(real_kitti, number, lags, as_is, shifted, at_packets, ends):
    d = packets(real_kitti, number)
    times = stamps(drive_of(real_kitti, number) / 'oxts' / 'timestamps.txt')[: len(d['yaw'])]
    seconds = (times - times[0]) / 1e9
    attitudes = [rotation(*each) for each in zip(d['roll'], d['pitch'], d['yaw'], strict=True)]
    turned = np.array([turn_vector(a.T @ b) for a, b in pairwise(attitudes)])
    rates = np.column_stack([d['wx'], d['wy'], d['wz']])
    fine = np.linspace(0, seconds[-1], 10 * len(seconds) * 10)

    def off(lag: float, known: np.ndarray = rates) -> np.ndarray:
        """(3,) milliradians a step by which rates of a later moment differ from attitudes."""
        found = []
        for axis in range(3):
            rate = np.interp(fine + lag, seconds, known[:, axis])
            steps = (rate[1:] + rate[:-1]) / 2 * np.diff(fine)
            way = np.interp(seconds, fine, np.concatenate([[0], np.cumsum(steps)]))
            found.append(np.diff(way) - turned[:, axis])
        return 1e3 * np.sqrt((np.array(found)[:, 3:-3] ** 2).mean(axis=1))

    tried = np.arange(0, 0.1, 0.002)
    best = tried[np.argmin([off(lag) for lag in tried], axis=0)]
    np.testing.assert_allclose(1e3 * best, lags, atol=4)
    later = np.column_stack([np.interp(seconds + 0.055, seconds, each) for each in rates.T])
    for found, told in ((off(0), as_is), (off(0.055), shifted), (off(0, later), at_packets)):
        assert np.sqrt((found**2).mean()) == pytest.approx(told, abs=0.01)
    turn_s = 0.1032 / 2
    assert 1e3 * np.median(np.linalg.norm(later - rates, axis=1)) * turn_s == pytest.approx(
        ends, abs=0.01
    )
