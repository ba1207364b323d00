# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each file kind: written and read again, on the data sets' own files, and damaged ones."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import kitti_ros2
from kitti_ros2.model.streams import Layout

SUFFIXES = {
    'scan': '*.bin',
    'image': '*.png',
    'labels': 'label_0*/*.txt',
    'oxts': 'oxts/**/0*.txt',
    'poses': 'poses/*.txt',
    'stamps': 'time*s.txt',
    'tracklets': 'tracklet_labels.xml',
}
"""Kind to the files of all layouts that are restored byte for byte."""


def reader(kind):
    return getattr(kitti_ros2, f'read_{kind}')


def writer(kind):
    return getattr(kitti_ros2, f'write_{kind}')


def equal(one, other):
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return one == other


@pytest.mark.parametrize('kind', SUFFIXES)
def test_a_data_sets_files_are_written_again(kind, recordings, tmp_path):
    files = [
        path
        for layout, root in recordings.items()
        for path in sorted((root.parent if layout is Layout.RAW else root).rglob(SUFFIXES[kind]))
        if path.is_file() and path.stat().st_size
    ]
    assert files
    for path in files:
        copy = tmp_path / 'copy' / path.name
        writer(kind)(copy, reader(kind)(path))
        assert equal(reader(kind)(copy), reader(kind)(path)), path
        if kind in {'scan', 'stamps', 'tracklets'}:
            assert copy.read_bytes() == path.read_bytes(), path
        copy.unlink()


@given(
    npst.arrays(np.float32, st.tuples(st.integers(1, 9), st.just(4)), elements=st.floats(width=32))
)
def test_scans_are_bit_for_bit(tmp_path_factory, points):
    path = tmp_path_factory.mktemp('scan') / 'velodyne/000003.bin'
    kitti_ros2.write_scan(path, points)
    found = kitti_ros2.read_scan(path)
    assert found.tobytes() == points.tobytes()
    assert found.flags.writeable


@given(npst.arrays(np.uint32, st.integers(0, 9)))
def test_point_labels_are_bit_for_bit(tmp_path_factory, labels):
    path = tmp_path_factory.mktemp('labels') / '000003.label'
    kitti_ros2.write_point_labels(path, labels)
    np.testing.assert_array_equal(kitti_ros2.read_point_labels(path), labels)


@given(npst.arrays(np.uint8, st.sampled_from([(3, 4), (5, 2, 3), (1, 1)])))
def test_images_are_rgb(tmp_path_factory, pixels):
    path = tmp_path_factory.mktemp('image') / '000003.png'
    kitti_ros2.write_image(path, pixels)
    found = kitti_ros2.read_image(path)
    expected = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)
    np.testing.assert_array_equal(found, expected)
    if pixels.ndim == 3:
        np.testing.assert_array_equal(cv2.imread(str(path)), pixels[..., ::-1])


@given(npst.arrays(np.float64, (2, 3, 4), elements=st.floats(-1e4, 1e4)))
def test_poses_keep_seven_digits(tmp_path_factory, poses):
    path = tmp_path_factory.mktemp('poses') / '00.txt'
    kitti_ros2.write_poses(path, poses)
    found = kitti_ros2.read_poses(path)
    np.testing.assert_allclose(found[:, :3], poses, rtol=1e-6, atol=1e-300)
    np.testing.assert_array_equal(found[:, 3], [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize('layout', ['object', 'tracking', 'odometry', 'raw'])
def test_calibrations_keep_what_they_project(layout, recordings, tmp_path):
    rig = kitti_ros2.open(recordings[Layout.RAW]).calibration()
    path = tmp_path / ('2011_09_26' if layout == 'raw' else 'calib.txt')
    kitti_ros2.write_calibration(path, rig, layout)
    again = kitti_ros2.read_calibration(path)
    points = np.random.default_rng(2).uniform([5, -5, -2], [50, 5, 2], (50, 3))
    for camera in rig.cameras:
        np.testing.assert_allclose(
            again.project(points, camera)[0], rig.project(points, camera)[0], atol=2e-3
        )


def test_labels_of_a_detector_have_scores(recordings, tmp_path):
    frame = next(each for each in kitti_ros2.open(recordings[Layout.OBJECT]) if each.objects)
    boxes = [replace(each.label, score=0.25) for each in frame.objects]
    kitti_ros2.write_labels(tmp_path / '000000.txt', boxes)
    assert kitti_ros2.read_labels(tmp_path / '000000.txt') == boxes


@pytest.mark.parametrize('kind', [*SUFFIXES, 'calibration', 'point_labels'])
def test_a_missing_file_is_named(kind, tmp_path):
    path = tmp_path / 'nothing.bin'
    with pytest.raises(FileNotFoundError, match=str(path)) as found:
        reader(kind)(path)
    assert isinstance(found.value, kitti_ros2.KittiRos2Error)


@pytest.mark.parametrize('kind', [*SUFFIXES, 'point_labels'])
def test_a_folder_is_named(kind, tmp_path):
    with pytest.raises(kitti_ros2.KittiRos2Error, match=str(tmp_path)):
        reader(kind)(tmp_path)


@pytest.mark.parametrize(
    ('kind', 'name', 'data', 'message', 'line'),
    [
        ('scan', 'a.bin', b'123', 'cut inside a point', None),
        ('scan', 'a.bin', b'', 'is empty', None),
        ('scan', 'a.txt', b'1 2 3 4\n1 2\n', '2 values', 2),
        ('point_labels', 'a.label', b'12345', '5 bytes', None),
        ('image', 'a.png', b'\x89PNG\r\n\x1a\n', 'a.png', None),
        ('labels', 'a.txt', b'Car 0 0\n', '3 columns', 1),
        ('labels', 'a.txt', b'\xff\xfe', 'no text', None),
        ('oxts', 'a.txt', b'1 2 3\n', '3 values', 1),
        ('poses', '00.txt', b'1 2 3\n', '3 values', 1),
        ('stamps', 'timestamps.txt', b'2011-09-26 13:02:25.9\nnoon\n', "'noon'", 2),
        ('stamps', 'times.txt', b'0\nnan\n', 'nan', 2),
        ('tracklets', 'a.xml', b'<a>', 'no whole XML', None),
        ('calibration', 'calib.txt', b'P0: 1 2 3\n', 'P0', 1),
        ('calibration', 'calib.txt', b'', 'empty', None),
    ],
)
def test_a_damaged_file_is_named_with_its_line(kind, name, data, message, line, tmp_path):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(kitti_ros2.KittiRos2Error, match=message) as found:
        reader(kind)(path)
    assert str(path) in str(found.value)
    if line is not None:
        assert f'{path}:{line}: ' in str(found.value)


@pytest.mark.parametrize(
    ('kind', 'value', 'message'),
    [
        ('scan', np.zeros((2, 3)), r'\(2, 3\); expected \(N, 4\)'),
        ('image', np.zeros((2, 3)), 'float64'),
        ('image', np.zeros((2, 3, 4), np.uint8), r'\(2, 3, 4\)'),
    ],
)
def test_a_wrong_array_is_named(kind, value, message, tmp_path):
    with pytest.raises(kitti_ros2.KittiRos2Error, match=message):
        writer(kind)(tmp_path / 'a.bin', value)
    assert list(tmp_path.iterdir()) == []


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(kitti_ros2.KittiRos2Error, match='file'):
        kitti_ros2.write_scan(tmp_path / 'file/000000.bin', np.zeros((1, 4)))


def test_a_raw_calibration_without_a_file_is_named(recordings, tmp_path):
    date = tmp_path / '2011_09_26'
    date.mkdir()
    for path in Path(recordings[Layout.RAW].parent).glob('calib_*.txt'):
        shutil.copy(path, date)
    assert kitti_ros2.read_calibration(date).cameras == (0, 1, 2, 3)
    (date / 'calib_velo_to_cam.txt').unlink()
    with pytest.raises(kitti_ros2.KittiRos2Error, match=r'calib_velo_to_cam\.txt: no such file'):
        kitti_ros2.read_calibration(date)
