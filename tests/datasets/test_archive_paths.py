# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Places of files in an archive: KITTI's own folders, repacked ones, and no known ones."""

from __future__ import annotations

import pytest

from kitti_ros2.kitti.archives import paths_below, target_paths

DRIVE = '2011_09_26/2011_09_26_drive_0005_sync'
DRIVE_360 = '2013_05_28_drive_0000_sync'


@pytest.mark.parametrize(
    ('archive', 'name', 'target'),
    [
        # As KITTI packs them.
        ('2011_09_26_drive_0005_sync.zip', f'{DRIVE}/oxts/data/0000000000.txt', None),
        ('2011_09_26_calib.zip', '2011_09_26/calib_cam_to_cam.txt', None),
        ('2011_09_26_drive_0005_tracklets.zip', f'{DRIVE}/tracklet_labels.xml', None),
        ('data_object_image_2.zip', 'testing/image_2/000000.png', None),
        ('data_tracking_label_2.zip', 'training/label_02/0000.txt', None),
        ('data_odometry_velodyne.zip', 'dataset/sequences/00/velodyne/000000.bin', None),
        ('data_odometry_poses.zip', 'dataset/poses/00.txt', None),
        ('data_odometry_labels.zip', 'dataset/sequences/00/labels/000000.label', None),
        # Under other folders.
        ('a.zip', f'my/backup/{DRIVE}/oxts/dataformat.txt', f'{DRIVE}/oxts/dataformat.txt'),
        ('a.zip', '2011_09_26_drive_0005_sync/oxts/dataformat.txt', f'{DRIVE}/oxts/dataformat.txt'),
        ('a.tgz', './kitti/object/training/calib/000000.txt', 'training/calib/000000.txt'),
        ('a.zip', 'KITTI/odometry/sequences/07/times.txt', 'dataset/sequences/07/times.txt'),
        ('a.zip', 'x/poses/07.txt', 'dataset/poses/07.txt'),
        ('a.zip', '07/velodyne/000000.bin', 'dataset/sequences/07/velodyne/000000.bin'),
        ('a.zip', 'kitti/ImageSets/train.txt', 'ImageSets/train.txt'),
        # Without their folders.
        ('2011_10_03_calib.zip', 'calib_velo_to_cam.txt', '2011_10_03/calib_velo_to_cam.txt'),
        ('2011_09_26_drive_0005_sync.zip', 'x/image_02/timestamps.txt',
         f'{DRIVE}/image_02/timestamps.txt'),
        ('2011_09_26_drive_0005_tracklets.zip', 'tracklet_labels.xml',
         f'{DRIVE}/tracklet_labels.xml'),
        ('2011_09_26_drive_0005_extract (1).zip', 'oxts/data/0.txt',
         '2011_09_26/2011_09_26_drive_0005_extract/oxts/data/0.txt'),
        ('label_2.zip', 'data/label_2/000000.txt', 'label_2/000000.txt'),
        # KITTI-360, with and without the folder above its drives.
        ('data_poses.zip', f'data_poses/{DRIVE_360}/poses.txt', None),
        ('data_poses.zip', f'{DRIVE_360}/poses.txt', f'data_poses/{DRIVE_360}/poses.txt'),
        ('data_poses_oxts.zip', f'{DRIVE_360}/oxts/timestamps.txt',
         f'data_poses/{DRIVE_360}/oxts/timestamps.txt'),
        (f'{DRIVE_360}_image_00.zip', f'{DRIVE_360}/image_00/data_rect/0000000000.png',
         f'data_2d_raw/{DRIVE_360}/image_00/data_rect/0000000000.png'),
        (f'{DRIVE_360}_velodyne.zip', 'velodyne_points/data/0000000000.bin',
         f'data_3d_raw/{DRIVE_360}/velodyne_points/data/0000000000.bin'),
        ('data_timestamps_velodyne.zip', f'{DRIVE_360}/velodyne_points/timestamps.txt',
         f'data_3d_raw/{DRIVE_360}/velodyne_points/timestamps.txt'),
        (f'{DRIVE_360}_sick.zip', f'{DRIVE_360}/sick_points/timestamps.txt',
         f'data_3d_raw/{DRIVE_360}/sick_points/timestamps.txt'),
        ('a.zip', f'KITTI-360/data_2d_raw/{DRIVE_360}/image_02/timestamps.txt',
         f'data_2d_raw/{DRIVE_360}/image_02/timestamps.txt'),
        ('data_3d_bboxes.zip', f'data_3d_bboxes/train/{DRIVE_360}.xml', None),
        ('data_3d_test_slam.zip', f'data_3d_test_slam/test_0/{DRIVE_360}/velodyne_points/a', None),
        ('data_3d_test_slam.zip', f'test_1/{DRIVE_360}/velodyne_points/timestamps.txt',
         f'data_3d_test_slam/test_1/{DRIVE_360}/velodyne_points/timestamps.txt'),
        ('calibration.zip', 'calibration/perspective.txt', None),
        ('calibration.zip', 'x/image_02.yaml', 'calibration/image_02.yaml'),
        # Devkits.
        ('devkit_object.zip', 'mapping/train_rand.txt', 'devkit_object/mapping/train_rand.txt'),
        ('devkit_raw_data.zip', 'devkit/readme.txt', 'devkit_raw_data/readme.txt'),
        ('devkit_object.zip', 'devkit_object/cpp/a.h', 'devkit_object/cpp/a.h'),
    ],
)  # fmt: skip
def test_a_place(archive, name, target):
    assert target_paths([name], archive) == [target or name]


def test_other_files_stay_beside_the_known_ones():
    files = ['kitti/training/calib/000000.txt', 'kitti/README.md', 'NOTES', 'kitti/planes/0.txt']
    assert target_paths(files, 'a.zip') == [
        'training/calib/000000.txt', 'README.md', 'NOTES', 'planes/0.txt'
    ]  # fmt: skip


def test_a_root_that_is_the_top_folder(tmp_path):
    scan = 'dataset/sequences/00/velodyne/000000.bin'
    assert paths_below(tmp_path, [scan]) == [scan]
    assert paths_below(tmp_path / 'dataset', [scan]) == ['sequences/00/velodyne/000000.bin']
    assert paths_below(tmp_path / '2011_09_26', [f'{DRIVE}/oxts/a']) == [
        '2011_09_26_drive_0005_sync/oxts/a'
    ]
    pose = f'data_poses/{DRIVE_360}/poses.txt'
    assert paths_below(tmp_path / 'data_poses', [pose]) == [f'{DRIVE_360}/poses.txt']
    (tmp_path / 'sequences').mkdir()
    assert paths_below(tmp_path, [scan]) == ['sequences/00/velodyne/000000.bin']
