# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scans of other columns are detected; KITTI's, and those of other scanners, are left alone."""

from __future__ import annotations

import io
import re
from types import SimpleNamespace

import numpy as np
import pytest

from kitti_ros2.kitti.scan_file import HEAD_BYTES, detect_scan_format, find_mismatch
from kitti_ros2.kitti.store import STORE
from kitti_ros2.model.streams import Stream

from builders import SHARED  # isort: skip

SCANS = [path for folder in ('kitti', 'kitti360') for path in (SHARED / folder).rglob('*.bin')]
TRIALS = 8


def street(rng, count, reflectance=1.0):
    """Points of a scanner on a road: around, near the ground, up to 60 m."""
    azimuth, distance = rng.uniform(-np.pi, np.pi, count), rng.gamma(2, 6, count) + 2.5
    z = np.maximum(-1.73, distance * np.tan(np.radians(rng.uniform(-24, 3, count))))
    x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
    values = np.round(rng.beta(2, 5, count), 2) * reflectance
    return np.stack([x, y, z, values], 1).astype('<f4')


def with_columns(points, *columns):
    filled = [np.broadcast_to(each, len(points))[:, None] for each in columns]
    return np.concatenate([points, *filled], axis=1).astype('<f4')


def radar(rng, count):
    """x y z RCS, ahead."""
    points = street(rng, count)
    return np.stack(
        [np.abs(points[:, 0]), points[:, 1], points[:, 2], rng.normal(-10, 10, count)], 1
    )


def tj4d(rng, count):
    points = radar(rng, count)
    distance = np.linalg.norm(points[:, :3], axis=1)
    angles = np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / distance)
    return with_columns(points, distance, rng.normal(12, 6, count), *angles)


OTHERS = {
    '3 float32': [lambda rng, n: street(rng, n)[:, :3]],
    '5 float32': [
        lambda rng, n: with_columns(street(rng, n, 255).round(), rng.integers(0, 32, n)),
        lambda rng, n: with_columns(street(rng, n), rng.integers(0, 64, n)),
        lambda rng, n: with_columns(street(rng, n), 0.45),
    ],
    '6 float32': [
        lambda rng, n: with_columns(street(rng, n), rng.random(n), 1.55e15),
        lambda rng, n: with_columns(street(rng, n), rng.random(n), 0),
        lambda rng, n: with_columns(street(rng, n)[:, :3], *rng.integers(0, 256, (3, n))),
    ],
    '7 float32': [
        lambda rng, n: with_columns(radar(rng, n), rng.normal(0, 3, n), rng.normal(2, 3, n), 0)
    ],
    '8 float32': [
        tj4d,
        lambda rng, n: with_columns(street(rng, n), *rng.dirichlet([0.3] * 4, n).T),
        lambda rng, n: with_columns(street(rng, n), *rng.integers(0, 256, (4, n))),
    ],
    '9 float32': [
        lambda rng, n: with_columns(
            street(rng, n), np.arange(n) * 1e3, *rng.integers(0, 900, (4, n))
        )
    ],
    '12 float32': [lambda rng, n: with_columns(street(rng, n), *rng.random((8, n)))],
    '24 float32': [lambda rng, n: with_columns(street(rng, n), *rng.dirichlet([0.3] * 20, n).T)],
    '3 float64': [lambda rng, n: street(rng, n)[:, :3].astype('<f8')],
    '4 float64': [
        lambda rng, n: street(rng, n).astype('<f8'),
        lambda rng, n: street(rng, n).astype('<f8').round(3),
    ],
    '5 float64': [
        lambda rng, n: with_columns(street(rng, n), rng.integers(0, 64, n)).astype('<f8')
    ],
}


def look(points):
    data = np.ascontiguousarray(points).tobytes()
    return find_mismatch([(data[:HEAD_BYTES], len(data))])


@pytest.mark.parametrize('count', [300, 5000])
@pytest.mark.parametrize(
    ('expected', 'make'), [(name, make) for name, makes in OTHERS.items() for make in makes]
)
def test_another_number_of_columns_is_detected(expected, make, count):
    for seed in range(TRIALS):
        found = look(make(np.random.default_rng(seed), count + seed))
        assert found is not None
        assert f' {expected} a point' in found.problem


def fields(points, rng):
    """The changes to scans that KITTI's users make, each a scan of 4 float32 a point."""
    yield points
    yield points[rng.permutation(len(points))]
    for column in range(4):
        yield points[np.argsort(points[:, column])]
    yield points[points[:, 0] > 0]
    yield points[(points[:, 0] > 0) & (np.abs(points[:, 1]) < 5)]
    yield points[(points > 0).all(axis=1)]
    yield points[::7]
    for reflectance in (0, 1, points[:, 3] * 100, np.rint(points[:, 3] * 255), points[:, 3] - 0.5):
        yield np.concatenate([points[:, :3], np.broadcast_to(reflectance, len(points))[:, None]], 1)
    yield np.repeat(points, 2, axis=0)
    for count in (1, 2, 3, 5, 8, 13, 21, 34, 55, 100):
        yield points[:count]
        yield rng.choice(points, min(count, len(points)), replace=False)


@pytest.mark.parametrize('seed', range(TRIALS))
def test_kittis_columns_are_left_alone(seed):
    rng = np.random.default_rng(seed)
    for points in fields(street(rng, 4000), rng):
        assert look(points.astype('<f4')) is None


@pytest.mark.skipif(not SCANS, reason='no real scans beside the repository')
def test_real_scans_are_left_alone():
    rng = np.random.default_rng(0)
    for index, path in enumerate(SCANS):
        points = np.fromfile(path, '<f4').reshape(-1, 4)
        for changed in [points] if index % 7 else fields(points, rng):
            assert look(changed.astype('<f4')) is None, path


@pytest.mark.parametrize('lasers', [2, 4, 16, 32])
def test_lasers_in_turn_are_no_columns(lasers):
    """Of a scanner of few lasers, written in the order of firing, low and high in turn."""
    rng = np.random.default_rng(lasers)
    elevation = np.radians(np.linspace(-15, 15, lasers))
    order = np.arange(lasers).reshape(2, -1).T.ravel()
    apart = np.radians(rng.uniform(-4, 4, lasers))
    azimuth = np.radians(np.arange(0, 360, 0.2))[:, None] + apart[order]
    distance = np.where(elevation < 0, 1.8 / np.tan(np.maximum(-elevation, 0.01)), 40)[order]
    distance = np.broadcast_to(np.minimum(distance, 60), azimuth.shape) * rng.uniform(
        0.9, 1, (1800, 1)
    )
    place = [distance * np.cos(azimuth), distance * np.sin(azimuth)]
    z = distance * np.tan(elevation[order])
    for scale in (1, 100, 255):
        values = rng.integers(0, 100, z.shape) / 100 * scale
        points = np.stack([*place, z, values], -1).reshape(-1, 4).astype('<f4')
        for start in (0, 1, 1500):
            assert look(points[start:]) is None


@pytest.mark.parametrize(
    ('missing', 'share'),
    [(0, 0.7), (0, 0.9), (0, 0.99), (np.nan, 0.7), (np.nan, 0.99), (np.nan, 1)],
)
@pytest.mark.parametrize('upper', [0, 1])
def test_lasers_that_look_into_the_sky_are_no_columns(missing, share, upper):
    """Of a scanner that fires high and low lasers in turn, with a row for each shot."""
    rng = np.random.default_rng(0)
    azimuth, sky = np.radians(np.arange(0, 360, 0.2))[:, None], np.arange(16) % 2 == upper
    elevation = np.radians(np.where(sky, 1, -1) * np.arange(1, 17))
    distance = np.where(sky, 20, 1.8 / np.sin(np.abs(elevation))) * rng.uniform(0.9, 1, (1800, 1))
    place = [distance * np.cos(azimuth), distance * np.sin(azimuth), distance * np.tan(elevation)]
    points = np.stack([*place, rng.integers(0, 255, place[0].shape)], -1).astype('<f4')
    points[sky & (rng.random((1800, 16)) < share)] = missing
    assert look(points.reshape(-1, 4)) is None


def test_coordinates_of_a_map_are_left_alone():
    rng = np.random.default_rng(0)
    points = street(rng, 4000) + np.float32([4.5e5, 5.4e6, 110, 0])
    assert look(points.astype('<f4')) is None


@pytest.mark.parametrize('fields', [{'ring': '<u2'}, {'ring': '<u2', 'time': '<f4'}])
def test_records_of_other_types_are_no_columns(fields):
    """Every second point would be read: those of NumPy's records of 18 and 22 bytes."""
    rng = np.random.default_rng(0)
    records = np.zeros(4000, [*((name, '<f4') for name in 'xyzi'), *fields.items()])
    for name, values in zip('xyzi', street(rng, 4000, 255).T, strict=True):
        records[name] = values
    records['ring'] = rng.integers(0, 64, 4000)
    assert 'cannot be float32' in look(records).problem


def test_a_fourth_column_that_is_no_reflectance_is_named():
    """Such as colours packed into a float, or times."""
    rng = np.random.default_rng(0)
    points = street(rng, 4000)
    for fourth in (rng.integers(0, 1 << 24, 4000).astype('<u4').view('<f4'), 1.6e9):
        points[:, 3] = fourth
        assert 'fourth value of most points is no reflectance' in look(points).problem


def test_what_cannot_be_known_is_left_alone():
    """Empty, all zeros, and the same place again and again have no columns."""
    assert find_mismatch([]) is None
    assert look(np.zeros((0, 4), '<f4')) is None
    assert look(np.zeros((500, 4), '<f4')) is None
    assert look(np.ones((500, 4), '<f4')) is None
    assert look(np.full((500, 4), np.nan, '<f4')) is None
    assert look(np.arange(4000, dtype='<f4').reshape(-1, 4)) is None


def saved():
    file = io.BytesIO()
    np.save(file, street(np.random.default_rng(0), 40))
    return file.getvalue()


@pytest.mark.parametrize(
    ('data', 'said'),
    [
        (saved(), r'NumPy file \(.npy\) of f4 \(40, 4\)'),
        (b'# .PCD v0.7 - Point Cloud Data', 'PCD'),
        (b'ply\nformat binary_little_endian 1.0', 'PLY'),
        (b'LASF' + bytes(300), 'LAS file'),
        (b'PK\x03\x04' + bytes(60), 'ZIP'),
        (b'\x1f\x8b\x08' + bytes(61), 'gzip'),
        (b'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n', 'Git LFS'),
        (b'12.5 3.25 -1.5 0.25\n' * 40, 'text file'),
        (street(np.random.default_rng(0), 99).astype('<f2').tobytes(), 'cannot be float32'),
        ((street(np.random.default_rng(0), 99) * 100).astype('<i2').tobytes(), 'cannot be float32'),
        (np.random.default_rng(0).bytes(4096), 'cannot be float32'),
    ],
)
def test_other_formats_are_named(data, said):
    found = find_mismatch([(data[:HEAD_BYTES], len(data))])
    assert found is not None
    assert re.search(said, found.problem)


def test_labels_tell_how_many_points_there_are():
    rng = np.random.default_rng(0)
    few = with_columns(street(rng, 16), *np.zeros((2, 16))).tobytes()
    assert '6 float32' in find_mismatch([(few, len(few))], 16).problem
    four = tj4d(rng, 300).astype('<f4').tobytes()
    assert find_mismatch([(four, len(four))], 600) is None


def folder(tmp_path, scans):
    """A recording of scans, as far as the check reads it."""
    for number, points in enumerate(scans):
        (tmp_path / f'{number:06d}.bin').write_bytes(np.ascontiguousarray(points).tobytes())
    listing = STORE.list_numbered(tmp_path, ('.bin',), 6)
    return SimpleNamespace(
        listings={Stream.SCAN: listing},
        options=SimpleNamespace(columns=None),
    )


def test_one_damaged_scan_is_not_the_whole_set(tmp_path):
    rng = np.random.default_rng(0)
    noise = np.frombuffer(rng.bytes(64_000), '<u1')
    assert (
        detect_scan_format(folder(tmp_path, [noise] + [street(rng, 900)] * 5), labelled=False).error
        is None
    )


def test_small_scans_are_looked_at_together(tmp_path):
    rng = np.random.default_rng(0)
    few = [with_columns(street(rng, 12), *rng.dirichlet([0.3] * 4, 12).T) for _ in range(8)]
    error = detect_scan_format(folder(tmp_path, few), labelled=False).error
    assert error is not None
    assert '8 float32 a point' in str(error)
