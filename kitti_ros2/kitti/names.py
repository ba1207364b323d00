# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's folder and file names.

Sources: the readme.txt of the raw, object, odometry and tracking devkits.
"""

from __future__ import annotations

import re

from ..model.errors import UsageError

RAW_DIGITS = 10
FRAME_DIGITS = 6
SEQUENCE_DIGITS = 4

RAW_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
RAW_SCANS = 'velodyne_points'
RAW_OXTS = 'oxts'
RAW_DATA = 'data'
RAW_DEPTH = 'proj_depth/velodyne_raw'
"""Depth maps of scans, a folder a colour camera (readme.txt of the depth devkit)."""
RAW_TRACKLETS = 'tracklet_labels.xml'
RAW_DRIVE = re.compile(r'\d{4}_\d{2}_\d{2}_drive_(\d{4})_(sync|extract)')
RAW_DATE = re.compile(r'\d{4}_\d{2}_\d{2}')
TIMESTAMPS = 'timestamps.txt'
TIMESTAMPS_START = 'timestamps_start.txt'
TIMESTAMPS_END = 'timestamps_end.txt'
RAW_LABEL_STAMPS = f'{RAW_IMAGES[2]}/{TIMESTAMPS}'
"""The stamps of tracklets in a drive without scans."""
DATAFORMAT = 'dataformat.txt'
CALIB_CAM_TO_CAM = 'calib_cam_to_cam.txt'
CALIB_VELO_TO_CAM = 'calib_velo_to_cam.txt'
CALIB_IMU_TO_VELO = 'calib_imu_to_velo.txt'
RAW_CALIB = (CALIB_CAM_TO_CAM, CALIB_VELO_TO_CAM, CALIB_IMU_TO_VELO)

SPLITS = ('training', 'testing')
OBJECT_IMAGES = ('image_0', 'image_1', 'image_2', 'image_3', 'image_4')
TRACKING_IMAGES = ('image_00', 'image_01', 'image_02', 'image_03')
SCANS = 'velodyne'
CALIB = 'calib'
OXTS = 'oxts'
OBJECT_LABELS = 'label_2'
OBJECT_DEPTH = 'depth_2'
"""Depth maps of camera 2, as OpenPCDet and CaDDN name the folder; KITTI's set has none."""
TRACKING_LABELS = 'label_02'
IMAGE_SETS = 'ImageSets'

DATASET = 'dataset'
SEQUENCES = 'sequences'
POSES = 'poses'
TIMES = 'times.txt'
ODOMETRY_CALIB = 'calib.txt'
ODOMETRY_DRIVES = {
    '00': '2011_10_03_drive_0027',
    '01': '2011_10_03_drive_0042',
    '02': '2011_10_03_drive_0034',
    '03': '2011_09_26_drive_0067',
    '04': '2011_09_30_drive_0016',
    '05': '2011_09_30_drive_0018',
    '06': '2011_09_30_drive_0020',
    '07': '2011_09_30_drive_0027',
    '08': '2011_09_30_drive_0028',
    '09': '2011_09_30_drive_0033',
    '10': '2011_09_30_drive_0034',
}
"""The raw drive that each training sequence is a part of (odometry devkit)."""
POINT_LABELS = 'labels'

PNG = '.png'
BIN = '.bin'
TXT = '.txt'
LABEL = '.label'


def file_name(number: int, digits: int, suffix: str) -> str:
    """Return the name of a numbered file, such as 0000000012.png."""
    return f'{number:0{digits}d}{suffix}'


def check_split(name: str) -> None:
    """Check the name of a split.

    Raises:
        UsageError: There is no such split.
    """
    if name not in SPLITS:
        raise UsageError(f'no split {name!r}; there are {" and ".join(SPLITS)}')


def parse_drive(name: str) -> tuple[str, int, str]:
    """Parse the name of a raw drive into date, number and kind (sync or extract).

    Raises:
        UsageError: The name is not that of a drive.
    """
    match = RAW_DRIVE.fullmatch(name)
    if match is None:
        raise UsageError(f'{name} is no drive; expected a name like 2011_09_26_drive_0001_sync')
    return name[: len('2011_09_26')], int(match[1]), match[2]


def drive_of(name: str) -> str | None:
    """Return the drive of a raw recording, the same of sync and extract; None for other names."""
    return name.rpartition('_')[0] if RAW_DRIVE.fullmatch(name) else None


def parse_sequence(name: str) -> int:
    """Parse the name of a sequence into its number.

    Raises:
        UsageError: The name is no number of a sequence.
    """
    if not (name.isascii() and name.isdecimal()) or len(name) > SEQUENCE_DIGITS:
        raise UsageError(f'{name} is no sequence; expected a number like 00 or 0000')
    return int(name)
