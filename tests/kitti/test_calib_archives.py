# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Missing calibration: the archive that has it, and where it goes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from kitti_ros2.kitti.archives import describe_source
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout
from kitti_ros2.validation.validate import validate

from builders import convert_recording  # isort: skip

WHERE = {
    Layout.RAW: '2011_09_26_calib.zip has it (kitti-ros2 extract 2011_09_26_calib.zip {root})',
    Layout.OBJECT: "data_object_calib.zip has it for KITTI's own data (kitti-ros2 extract "
    'data_object_calib.zip {root})',
    Layout.TRACKING: 'own data (kitti-ros2 extract data_tracking_calib.zip {root})',
    Layout.ODOMETRY: 'own data (kitti-ros2 extract data_odometry_calib.zip {root})',
    Layout.KITTI_360: 'own data (kitti-ros2 extract calibration.zip {root})',
}  # fmt: skip


@pytest.mark.parametrize('layout', list(Layout))
def test_a_recording_without_calibration(recordings, tmp_path, layout):
    whole = recordings[layout].parent if layout is Layout.RAW else recordings[layout]
    root = tmp_path / 'set'
    copy = root / whole.name if layout is Layout.RAW else root
    shutil.copytree(whole, copy)
    for path in [*copy.rglob('calib*.txt'), *copy.glob('*/calib'), *copy.glob('calibration')]:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    recording = open_recording(copy)
    missing = recording.calibration(0).missing.values()
    assert any(each.endswith(WHERE[layout].format(root=root)) for each in missing)
    report = convert_recording(copy, tmp_path / 'o.mcap')
    own = [loss.message for loss in report.losses if loss.stream == 'calibration']
    # One line for each file, not for each frame.
    assert len(own) == (3 if layout in {Layout.RAW, Layout.KITTI_360} else 1)


def test_one_missing_file_of_an_object_set_is_named(recordings, tmp_path):
    shutil.copytree(recordings[Layout.OBJECT], tmp_path / 'set')
    (tmp_path / 'set' / 'training' / 'calib' / '000002.txt').unlink()
    [reason] = open_recording(tmp_path / 'set').calibration(2).missing.values()
    assert 'training/calib/000002.txt: no such file; data_object_calib.zip has it' in reason


@pytest.mark.parametrize(
    ('layout', 'path', 'said'),
    [
        (Layout.RAW, '/k/2011_10_03/calib_cam_to_cam.txt',
         '2011_10_03_calib.zip has it (kitti-ros2 extract 2011_10_03_calib.zip /k)'),
        (Layout.RAW, '/k/2011_10_03', 'extract 2011_10_03_calib.zip /k)'),
        (Layout.RAW, '/k.d/2011_10_03_drive_0001_sync',
         "2011_10_03_calib.zip '2011_10_03/*' -d /k.d/2011_10_03_drive_0001_sync)"),
        (Layout.RAW, '/k/2011_09_28_drive_0001_sync/calib_cam_to_cam.txt',
         'zip 2011_09_28/calib_cam_to_cam.txt -d /k/2011_09_28_drive_0001_sync)'),
        (Layout.OBJECT, '/k/testing/calib', 'extract data_object_calib.zip /k)'),
        (Layout.OBJECT, '/k/mine/calib',
         "unzip -j data_object_calib.zip 'training/calib/*' -d /k/mine/calib)"),
        (Layout.TRACKING, '/k/testing/calib/0003.txt', 'extract data_tracking_calib.zip /k)'),
        (Layout.ODOMETRY, '/k/dataset/sequences/07/calib.txt',
         'extract data_odometry_calib.zip /k)'),
        (Layout.ODOMETRY, '/k/sequences/07/calib.txt', 'extract data_odometry_calib.zip /k)'),
        (Layout.ODOMETRY, '/my k/07/calib.txt',
         "dataset/sequences/07/calib.txt -d '/my k/07')"),
    ],
)  # fmt: skip
def test_where_it_goes(layout, path, said):
    assert describe_source(layout, Path(path)).endswith(said)


@pytest.mark.parametrize(
    ('folder', 'drive', 'said'),
    [
        ('mine', '2011_10_03_drive_0027_sync', '2011_10_03_calib.zip has it (unzip -j '),
        ('2011_09_26', '2011_10_03_drive_0027_sync', '2011_10_03_calib.zip has it (unzip -j '),
        ('2011_10_03', '2011_10_03_drive_0027_sync', 'has it (kitti-ros2 extract '),
        ('2011_09_30', 'my_drive', '2011_09_30_calib.zip has it'),
        ('mine', 'my_drive', 'the drive needs the calibration of its own day'),
        ('mine', '2013_05_28_drive_0000_sync', '2013_05_28, which is no day of KITTI'),
    ],
)  # fmt: skip
def test_the_archive_is_that_of_the_drives_own_day(tmp_path, folder, drive, said):
    """No day is guessed; a folder of other days does not get the calibration of one."""
    place = tmp_path / folder / drive
    scans = place / 'velodyne_points' / 'data'
    scans.mkdir(parents=True)
    (scans / '0000000000.bin').write_bytes(bytes(16))
    (scans.parent / 'timestamps.txt').write_text('2011-10-03 12:55:34.000000000\n')
    missing = open_recording(place).calibration(0).missing['calib_velo_to_cam.txt']
    assert said in missing
    dated = drive.startswith(folder)
    assert missing.startswith(str(place.parent if dated or drive == 'my_drive' else place))


DAYS = {
    '2011_09_26': '09-Jan-2012 13:57:47',
    '2011_10_03': '09-Jan-2012 14:00:15',
    '': '01-Jan-2020 00:00:00',
}


@pytest.mark.parametrize('day', DAYS)
def test_a_calibration_of_another_day_is_noticed(recordings, tmp_path, day):
    root = tmp_path / '2011_09_26'
    shutil.copytree(recordings[Layout.RAW].parent, root)
    path = root / 'calib_cam_to_cam.txt'
    path.write_text(f'calib_time: {DAYS[day]}\n{path.read_text()}')
    report = convert_recording(root, tmp_path / 'o.mcap')
    assert not report.losses
    said = [note for note in report.notes if 'calib_time' in note]
    assert len(said) == (day == '2011_10_03')
    assert all(day in note and 'the drive is of 2011_09_26' in note for note in said)
    found = [each for each in validate([root]).findings if each.rule == 'calib-day']
    assert len(found) == len(said)
