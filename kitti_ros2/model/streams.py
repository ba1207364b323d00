# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's layouts with their traits, the streams of a recording, and the meaning of its stamps.

A *stream* is one sensor's series. A *sample* is what one file (or one line) of it holds. A sample's
*number* is its KITTI file number: streams are paired by number, never by position in a listing.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    SCAN = 'scan'
    IMAGE_0 = 'image_0'
    IMAGE_1 = 'image_1'
    IMAGE_2 = 'image_2'
    IMAGE_3 = 'image_3'
    IMAGE_4 = 'image_4'
    LABELS = 'labels'

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


class Clock(str, Enum):
    """The meaning of a recording's stamps.

    UTC has date and time; RELATIVE has seconds from the start, at an assumed date; NOMINAL has no
    time at all, only the order of frames at an assumed rate.
    """

    UTC = 'utc'
    RELATIVE = 'relative'
    NOMINAL = 'nominal'


@dataclass(frozen=True)
class LayoutTraits:
    """The differences between layouts, apart from their files (see kitti.layouts).

    Attributes:
        title: What a recording of the layout is called in reports.
        default_name: The name of a new recording; {date} (YYYY_MM_DD) and {kind} (sync or extract)
            are filled in.
        streams: The streams that have a place in the layout.
        cameras: The cameras of the main download; other folders of images may be absent.
        clock: The meaning of the stamps, NOMINAL for a layout without time.
        stamps_per_stream: Whether each stream has its own stamps, so that any of them may have
            gaps; else a frame has one stamp.
        line_streams: Streams whose samples are lines of one text file for the whole recording.
        calibration_per_frame: Whether each frame has its own calibration and image sizes, because
            the frames are of different days.
        frame_set: Whether a recording is a split (training or testing) of a set of independent
            frames, which can be continued, instead of one drive or sequence.
        dated: Whether a recording lies in the folder of its date, which holds the calibration of
            that date in three files.
        extracts: Whether there are recordings named *_extract: their images are not rectified, and
            their streams have file numbers of their own.
        tracklets: Whether labels are tracklets of the whole recording, not lines of text.
        compensated_scans: Whether KITTI has compensated the scans for motion.
        point_labels: Whether the points of scans can have semantic labels.
    """

    title: str
    default_name: str
    streams: frozenset[Stream]
    cameras: tuple[int, ...] = (0, 1, 2, 3)
    clock: Clock = Clock.NOMINAL
    stamps_per_stream: bool = False
    line_streams: frozenset[Stream] = frozenset()
    calibration_per_frame: bool = False
    frame_set: bool = False
    dated: bool = False
    extracts: bool = False
    tracklets: bool = False
    compensated_scans: bool = False
    point_labels: bool = False

    def is_extract(self, name: str) -> bool:
        """Whether a recording of this name is unrectified, with file numbers of each stream."""
        return self.extracts and name.endswith('_extract')


class Layout(str, Enum):
    """KITTI's layouts: the ways in which its files are arranged in folders."""

    RAW = 'raw'
    OBJECT = 'object'
    ODOMETRY = 'odometry'
    TRACKING = 'tracking'

    @property
    def traits(self) -> LayoutTraits:
        """The differences from other layouts."""
        return _TRAITS[self]


*_FIRST, _LAST = (layout.value for layout in Layout)
LAYOUT_NAMES = f'{", ".join(_FIRST)} or {_LAST}'
"""For help texts."""

_COMMON_STREAMS = frozenset({Stream.CALIBRATION, Stream.SCAN, *IMAGE_STREAMS[:4]})
_TRAITS = {
    Layout.RAW: LayoutTraits(
        title='KITTI raw drive',
        default_name='{date}_drive_0001_{kind}',
        streams=_COMMON_STREAMS | {Stream.OXTS, Stream.LABELS},
        clock=Clock.UTC,
        stamps_per_stream=True,
        dated=True,
        extracts=True,
        tracklets=True,
    ),
    Layout.OBJECT: LayoutTraits(
        title='KITTI object detection set',
        default_name='training',
        streams=_COMMON_STREAMS | {Stream.IMAGE_4, Stream.LABELS},
        cameras=(2, 3),
        calibration_per_frame=True,
        frame_set=True,
    ),
    Layout.ODOMETRY: LayoutTraits(
        title='KITTI odometry sequence',
        default_name='00',
        streams=_COMMON_STREAMS | {Stream.POSE},
        clock=Clock.RELATIVE,
        line_streams=frozenset({Stream.POSE}),
        compensated_scans=True,
        point_labels=True,
    ),
    Layout.TRACKING: LayoutTraits(
        title='KITTI tracking sequence',
        default_name='0000',
        streams=_COMMON_STREAMS | {Stream.OXTS, Stream.LABELS},
        cameras=(2, 3),
        line_streams=frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS}),
    ),
}
