# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One ROS 1 .bag file (format 2.0), with ROS 1's own message definitions and md5 sums."""

from __future__ import annotations

import os
import struct
from typing import TYPE_CHECKING

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag1 import Writer

from ..files.durability import WritingOut
from .compressors import ros1_lz4
from .ros1_records import MAGIC
from .ros1_scan import Ros1Channel
from .ros1_types import Ros1Types

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import TypeAlias

    from ..model.channels import Channel
    from .contract import Parts, SegmentContext

    _Convert: TypeAlias = Callable[[bytes | memoryview], bytes | memoryview]

# roscpp writes the name of the publisher's node, which some readers show.
_CALLER = '/kitti_ros2'
_NUMBER = struct.Struct('<I')
_HEADER_BYTES = 4096  # of the bag header and its padding, without the length of either


class _ConnectionsById(list[Connection]):
    """The connections of a bag by id, in which one is found at once."""

    def __contains__(self, connection: object) -> bool:
        if not isinstance(connection, Connection):
            return False
        return self[connection.id : connection.id + 1] == [connection]


class Ros1Writer(Writer):
    """rosbags' writer of a .bag file, changed so that ROS 1 reads every compression and reindexes.

    Three things differ. Chunks of lz4 are as roslz4 requires them. A connection is not compared
    with all others when it is added or written to, which takes a minute for 65,000. The record of
    the bag header has the size of that in ROS 1's own bags: rosbag, when it appends or reindexes,
    overwrites that many bytes, and with them the first chunk if the record is shorter.

    Args:
        path: The file, which must not exist.
        compression: none, lz4 or bz2.

    Source: ros_comm, tools/rosbag_storage/src/bag.cpp, writeFileHeaderRecord.
    """

    def __init__(self, path: Path, compression: str) -> None:
        super().__init__(path)
        self.connections = _ConnectionsById()
        if compression != 'none':
            self.set_compression(self.CompressionFormat[compression.upper()])
        if compression == 'lz4':
            self.compressor = ros1_lz4

    def open(self) -> None:
        """Create the file.

        Raises:
            OSError: The file cannot be created.
        """
        super().open()
        if self.bio is not None:
            self.bio.flush()
            _lengthen_header(self.path)
            self.bio.seek(0, os.SEEK_END)

    def add(self, channel: Channel, definition: str, md5sum: str, caller: str | None) -> Connection:
        """Add a connection, of a topic that no other one has."""
        connection = Connection(
            len(self.connections),
            channel.topic,
            channel.msgtype,
            MessageDefinition(MessageDefinitionFormat.MSG, definition),
            md5sum,
            -1,
            ConnectionExtRosbag1(caller, int(channel.latched)),
            self,
        )
        self.write_connection(connection, self.chunks[-1].data)
        self.connections.append(connection)
        return connection

    def close(self) -> None:
        """Write the rest and the index."""
        super().close()  # which writes the bag header again
        _lengthen_header(self.path)


def _lengthen_header(path: Path) -> None:
    with path.open('r+b') as file:
        file.seek(len(MAGIC))
        (header_bytes,) = _NUMBER.unpack(file.read(_NUMBER.size))
        file.seek(header_bytes, os.SEEK_CUR)
        padding_bytes = _HEADER_BYTES - header_bytes
        file.write(_NUMBER.pack(padding_bytes) + b' ' * padding_bytes)


class Ros1Segment:
    """The writer of one .bag file."""

    def __init__(self, path: Path, context: SegmentContext) -> None:
        self._types = Ros1Types(context.typestore)
        self._writer = Ros1Writer(path, context.options.compression)
        self._channels: list[tuple[Connection, _Convert]] = []
        self._writer.open()
        self._writing_out = WritingOut(path)

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Write the connection's record, unchanged if it is copied from another ROS 1 bag."""
        del channel_id  # connections are numbered in order as well
        caller: str | None = _CALLER
        convert: _Convert
        if isinstance(channel, Ros1Channel):
            definition, md5sum = channel.definition, channel.md5sum
            caller, convert = channel.callerid, _unchanged
        else:
            definition, md5sum = self._types.definition(channel.msgtype)
            convert = self._types.converter(channel.msgtype)
        connection = self._writer.add(channel, definition, md5sum, caller)
        self._channels.append((connection, convert))

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message, converted unless it is copied from another ROS 1 bag."""
        connection, convert = self._channels[channel_id]
        data = parts[0] if len(parts) == 1 else b''.join(parts)
        self._writer.write(connection, stamp_ns, convert(data))
        self._writing_out.advance(len(data))

    def close(self, information: bytes) -> None:
        """Write the index."""
        del information  # the format cannot store it
        self._writing_out.close()
        self._writer.close()

    def abort(self) -> None:
        """Close the file."""
        self._writing_out.close()
        self._writer.abort()


def _unchanged(data: bytes | memoryview) -> bytes | memoryview:
    return data
