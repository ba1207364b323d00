# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The streams of a recording, and the meaning of its stamps.

A *stream* is one sensor's series. A *sample* is what one file (or one line) of it holds. A
sample's *number* is its KITTI file number: streams are paired by number, never by position in a
listing. OXTS_EXTRACT, the packets of the unsynchronised drive beside a synchronised one, has
numbers of its own, and is paired by time.
"""

from __future__ import annotations

from enum import Enum

CAMERA_COUNT = 5
CAMERA_NAMES = {0: 'gray_left', 1: 'gray_right', 2: 'color_left', 3: 'color_right'}
"""KITTI's cameras by index, as in topics and frames."""


class Stream(str, Enum):
    """The series of a recording; the order is the order of publishing at equal stamps."""

    RECORDING = 'recording'
    CALIBRATION = 'calibration'
    PATH = 'path'
    POSE = 'pose'
    OXTS = 'oxts'
    OXTS_EXTRACT = 'oxts_extract'
    SCAN = 'scan'
    IMAGE_0 = 'image_0'
    IMAGE_1 = 'image_1'
    IMAGE_2 = 'image_2'
    IMAGE_3 = 'image_3'
    IMAGE_4 = 'image_4'
    LABELS = 'labels'
    PREDICTIONS = 'predictions'

    @property
    def camera(self) -> int | None:
        """The KITTI camera index of an image stream, None for the others."""
        return int(self.value[-1]) if self.value.startswith('image_') else None


IMAGE_STREAMS: tuple[Stream, ...] = tuple(Stream(f'image_{i}') for i in range(CAMERA_COUNT))
FRAME_STREAMS = (
    Stream.SCAN,
    Stream.IMAGE_2,
    Stream.IMAGE_0,
    Stream.IMAGE_3,
    Stream.IMAGE_1,
    Stream.IMAGE_4,
    Stream.LABELS,
    Stream.OXTS,
    Stream.POSE,
)
"""The streams whose samples make frames.

If a file number is the same moment in all streams, every number of any of them is a frame.
Otherwise (a raw extract) the samples of the first stream that has any are the frames.
"""


UNNUMBERED = frozenset({Stream.OXTS_EXTRACT})
"""Streams whose file numbers are those of another drive: they are selected by time alone."""

STREAM_ALIASES = {
    'velodyne': Stream.SCAN,
    'velodyne_points': Stream.SCAN,
    'lidar': Stream.SCAN,
    'points': Stream.SCAN,
    'imu': Stream.OXTS,
    'gps': Stream.OXTS,
    'calib': Stream.CALIBRATION,
    'tracklets': Stream.LABELS,
    'boxes': Stream.LABELS,
    'results': Stream.PREDICTIONS,
}
"""Streams by other names that users may try."""


class Clock(str, Enum):
    """The meaning of a recording's stamps.

    UTC has date and time; RELATIVE has seconds from the start, at an assumed date; NOMINAL has no
    time at all, only the order of frames at an assumed rate.
    """

    UTC = 'utc'
    RELATIVE = 'relative'
    NOMINAL = 'nominal'
