# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's folder and file names, each in one place.

Sources: the readme.txt of the raw, object, odometry and tracking devkits.
"""

from __future__ import annotations

import re

RAW_DIGITS = 10
FRAME_DIGITS = 6
SEQUENCE_DIGITS = 4

RAW_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
RAW_SCANS = 'velodyne_points'
RAW_OXTS = 'oxts'
RAW_DATA = 'data'
RAW_TRACKLETS = 'tracklet_labels.xml'
RAW_DRIVE = re.compile(r'\d{4}_\d{2}_\d{2}_drive_(\d{4})_(sync|extract)')
RAW_DATE = re.compile(r'\d{4}_\d{2}_\d{2}')
TIMESTAMPS = 'timestamps.txt'
TIMESTAMPS_START = 'timestamps_start.txt'
TIMESTAMPS_END = 'timestamps_end.txt'
DATAFORMAT = 'dataformat.txt'
CALIB_CAM_TO_CAM = 'calib_cam_to_cam.txt'
CALIB_VELO_TO_CAM = 'calib_velo_to_cam.txt'
CALIB_IMU_TO_VELO = 'calib_imu_to_velo.txt'

SPLITS = ('training', 'testing')
OBJECT_IMAGES = ('image_0', 'image_1', 'image_2', 'image_3', 'image_4')
TRACKING_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
SCANS = 'velodyne'
CALIB = 'calib'
OXTS = 'oxts'
OBJECT_LABELS = 'label_2'
TRACKING_LABELS = 'label_02'
IMAGE_SETS = 'ImageSets'

SEQUENCES = 'sequences'
POSES = 'poses'
TIMES = 'times.txt'
ODOMETRY_CALIB = 'calib.txt'
POINT_LABELS = 'labels'

PNG = '.png'
BIN = '.bin'
TXT = '.txt'
LABEL = '.label'


def file_name(number: int, digits: int, suffix: str) -> str:
    """The name of a numbered file, such as 0000000012.png."""
    return f'{number:0{digits}d}{suffix}'
