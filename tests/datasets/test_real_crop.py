# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the real samples."""

from __future__ import annotations

import warnings

import pytest

from kitti_ros2 import KittiRos2Warning
from kitti_ros2.datasets import crop
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.scan import rings
from kitti_ros2.model.boxes import count_points
from kitti_ros2.model.samples import cuboids_of
from kitti_ros2.model.streams import Stream

OBJECT = 'object/training'
IN_IMAGE = {
    'raw/2011_09_26/2011_09_26_drive_0005_sync': (20478,),
    'raw/2011_09_26/2011_09_26_drive_0052_sync': (
        16333,
        16298,
        16125,
        15782,
        15469,
        15306,
        15196,
        15187,
    ),
    'odometry/dataset/sequences/00': (19369,),
}
"""By recording the points in the image of camera 2, of the first scans."""


def sizes(folder):
    return [path.stat().st_size // 16 for path in sorted(folder.iterdir())]


def test_the_reference_crop(real_kitti, tmp_path):
    crop(real_kitti / OBJECT, tmp_path / 'out', view='reference', copy=True)
    assert sizes(tmp_path / 'out/training/velodyne') == [19030, 15826, 18272]


def test_reduced_is_velodyne_reduced(real_kitti, tmp_path):
    report = crop(
        real_kitti / 'object',
        tmp_path / 'out',
        view='reduced',
        folder='velodyne_reduced',
        copy=True,
    )
    for path in sorted((real_kitti / OBJECT / 'velodyne_reduced').iterdir()):
        made = tmp_path / 'out/training' / path.parent.name / path.name
        assert made.read_bytes() == path.read_bytes()
    assert report.recordings[0].points_after == 20285 + 18630 + 20210
    assert report.losses == ()


@pytest.mark.parametrize('source', IN_IMAGE)
def test_points_in_the_image(source, real_kitti, tmp_path):
    options = {'image_size': (1241, 376)} if source.startswith('odometry') else {}
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', KittiRos2Warning)  # most scans of 0005 are not there
        report = crop(real_kitti / source, tmp_path / 'out', view='reduced', copy=True, **options)
    found = sizes(tmp_path / 'out' / report.recordings[0].folder)
    assert tuple(found[: len(IN_IMAGE[source])]) == IN_IMAGE[source]


def test_half_of_the_lasers(real_kitti, tmp_path):
    report = crop(real_kitti / OBJECT, tmp_path / 'out', lasers=32, copy=True)
    recording = open_recording(tmp_path / 'out')
    for number in range(3):
        assert rings(recording.read(Stream.SCAN, number).points).max() == 31
    assert 0.45 < report.recordings[0].points_after / report.recordings[0].points_before < 0.55


def test_points_in_labelled_boxes(real_kitti):
    recording = open_recording(real_kitti / OBJECT)
    found = []
    for number in range(3):
        points = recording.read(Stream.SCAN, number).points[:, :3]
        labels = recording.read(Stream.LABELS, number)
        cuboids = cuboids_of(labels, recording.calibration(number))
        classes = [each.class_name for each in cuboids]
        found.append([*zip(classes, count_points(cuboids, points), strict=True)])
    assert found == [
        [('Pedestrian', 376)],
        [('Truck', 70), ('Car', 9), ('Cyclist', 18)],
        [('Misc', 1351), ('Car', 67)],
    ]


def test_labels_whose_points_are_cut_off_are_dropped(real_kitti, tmp_path):
    crop(real_kitti / OBJECT, tmp_path / 'out', range=':30', empty_labels='drop', copy=True)
    for path in sorted((real_kitti / OBJECT / 'label_2').iterdir()):
        lines = path.read_bytes().splitlines(keepends=True)
        made = (tmp_path / 'out/training/label_2' / path.name).read_bytes()
        far = path.stem == '000001'
        kept = [line for line in lines if not far or line.startswith(b'DontCare')]
        if path.stem == '000002':
            kept = [line for line in lines if not line.startswith(b'Car')]
        assert made == b''.join(kept)
