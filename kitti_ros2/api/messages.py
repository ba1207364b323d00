# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a frame, as to-bag writes and the player publishes them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..exporter.encode import Encoder
from ..exporter.schedule import make_schedule
from ..kitti.recording import KittiRecording
from ..model.errors import KittiRos2Error, UsageError
from ..model.msgtypes import STRING
from ..model.streams import Stream
from ..options.selection import Bound
from ..options.table import TO_BAG, make_settings
from ..pictures.recording_frames import RecordingFrames
from .keywords import by_name

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from .frame import Frame
    from .keywords import ToBagKeywords

_OF_RECORDING = (Stream.RECORDING, Stream.PATH)


def encode(frame: Frame, **options: Unpack[ToBagKeywords]) -> dict[str, tuple[str, bytes]]:
    """Serialise the messages of a frame of a KITTI folder, without ROS.

    They are the bytes that `kitti-ros2 to-bag` writes for the frame: its scan, images, camera_info,
    IMU, labels and transforms. Topics of the whole recording (path, and the verbatim texts on
    /kitti/source) are left out.

    Args:
        frame: Of a recording opened from a KITTI folder.
        options: Those of `kitti-ros2 to-bag` that concern messages and topics: images='raw',
            topics=[...], ring_time=True, preset='kitti2bag', map='devkit', ...

    Returns:
        Topic to the name of the type and the message, CDR with its encapsulation header; publish it
        with rclpy as `publisher.publish(data)` of a publisher of that type.

    Raises:
        KittiRos2Error: The frame is of a bag, an option is invalid, or data cannot be read.

    Examples:
        >>> msgtype, data = kitti_ros2.encode(recording.frame(1))['/kitti/velo/points']
        >>> msgtype
        'sensor_msgs/msg/PointCloud2'
    """
    frames = frame.source.frames
    recording = frames.recording if isinstance(frames, RecordingFrames) else None
    if not isinstance(recording, KittiRecording):
        raise UsageError(f'{frame.source.path}: encode needs a KITTI folder; a bag has messages')
    settings = make_settings(by_name(options, TO_BAG))
    only = Bound(frame=frame.number)
    selection = replace(settings.selection, start=only, end=only)
    schedule = make_schedule(recording, selection)
    encoder = Encoder(recording, schedule, settings.messages, selection)
    found: dict[str, tuple[str, bytes]] = {}
    for entry in schedule:
        if entry.stream in _OF_RECORDING:
            continue
        messages, losses = encoder.encode(entry)
        for loss in losses:
            raise KittiRos2Error(loss.text())
        for message in messages:
            row = encoder.table[message.channel]
            if row.msgtype != STRING:
                found[row.topic] = row.msgtype, b''.join(message.parts)
    return found
