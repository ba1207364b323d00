# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One ROS 1 .bag file (format 2.0), with ROS 1's own message definitions and md5 sums."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.rosbag1 import Writer

from .ros1_types import Ros1Types

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from rosbags.interfaces import Connection

    from .contract import Channel, Parts, SegmentContext

# What roscpp writes for a publisher; readers that show it expect a node's name.
_CALLER = '/kitti_ros2'


class Ros1Segment:
    """The writer of one .bag file."""

    def __init__(self, path: Path, context: SegmentContext) -> None:
        self._types = Ros1Types(context.typestore)
        self._writer = Writer(path)
        if context.options.compression != 'none':
            self._writer.set_compression(
                Writer.CompressionFormat[context.options.compression.upper()]
            )
        self._channels: list[tuple[Connection, Callable[[bytes | memoryview], memoryview]]] = []
        self._writer.open()

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Write the connection's record."""
        del channel_id  # connections are numbered in order as well
        definition, md5sum = self._types.definition(channel.msgtype)
        connection = self._writer.add_connection(
            channel.topic,
            channel.msgtype,
            msgdef=definition,
            md5sum=md5sum,
            callerid=_CALLER,
            latching=int(channel.latched),
        )
        self._channels.append((connection, self._types.converter(channel.msgtype)))

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Convert one message and append it."""
        connection, convert = self._channels[channel_id]
        data = parts[0] if len(parts) == 1 else b''.join(parts)
        self._writer.write(connection, stamp_ns, convert(data))

    def close(self, information: str) -> None:
        """Write the index."""
        del information  # the format has no place for it
        self._writer.close()

    def abort(self) -> None:
        """Let go of the file."""
        self._writer.abort()
