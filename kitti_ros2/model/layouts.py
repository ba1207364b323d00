# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's layouts and their traits: what other rooms ask instead of which layout it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from .streams import IMAGE_STREAMS, Clock, Stream


@dataclass(frozen=True)
class LayoutTraits:
    """The differences between layouts, apart from their files (see kitti.layouts).

    Attributes:
        title: What a recording of the layout is called in reports.
        noun: The same in one word.
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
    noun: str
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

    @property
    def common_labels(self) -> bool:
        """Whether one file has the labels of all frames: a frame without any has no object."""
        return self.tracklets or Stream.LABELS in self.line_streams

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


_COMMON_STREAMS = frozenset({Stream.CALIBRATION, Stream.SCAN, *IMAGE_STREAMS[:4]})
_TRAITS = {
    Layout.RAW: LayoutTraits(
        title='KITTI raw drive',
        noun='drive',
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
        noun='split',
        default_name='training',
        streams=_COMMON_STREAMS | {Stream.IMAGE_4, Stream.LABELS},
        cameras=(2, 3),
        calibration_per_frame=True,
        frame_set=True,
    ),
    Layout.ODOMETRY: LayoutTraits(
        title='KITTI odometry sequence',
        noun='sequence',
        default_name='00',
        streams=_COMMON_STREAMS | {Stream.POSE},
        clock=Clock.RELATIVE,
        line_streams=frozenset({Stream.POSE}),
        compensated_scans=True,
        point_labels=True,
    ),
    Layout.TRACKING: LayoutTraits(
        title='KITTI tracking sequence',
        noun='sequence',
        default_name='0000',
        streams=_COMMON_STREAMS | {Stream.OXTS, Stream.LABELS},
        cameras=(2, 3),
        line_streams=frozenset({Stream.OXTS, Stream.POSE, Stream.LABELS}),
    ),
}
