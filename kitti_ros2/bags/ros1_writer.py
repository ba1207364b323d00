# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One ROS 1 .bag file (format 2.0), with ROS 1's own message definitions and MD5 sums.

The format stands in ros1_bag.py. The chunks are of the size of ROS 1's own recorder, and so is the
record of the bag header: rosbag, when it appends or reindexes, overwrites that many bytes, and with
them the first chunk if the record is shorter.

Source: ros_comm, tools/rosbag_storage/src/bag.cpp, writeFileHeaderRecord.
"""

from __future__ import annotations

import bz2
import struct
from typing import TYPE_CHECKING

import rosbags.typesys  # noqa: F401 - whole, before its modules: else threads wait in a circle
from rosbags.typesys.msg import denormalize_msgtype

from ..files.local_files import UnbufferedFile
from ..messages.ros_versions import Ros1Types
from .chunk_writer import ChunkContents, Chunks, CompressedChunks, StreamedChunks
from .file_writer import ros1_lz4
from .ros1_bag import (
    BAG_HEADER,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    MAGIC,
    MESSAGE,
    Ros1Channel,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..messages.ros_versions import Convert
    from ..model.bag_formats import Channel
    from .file_writer import Parts, WriterContext

CALLER = '/kitti_ros2'
"""Roscpp writes the name of the publisher's node, which some readers show."""

_CHUNK_BYTES = 2**20
_HEADER_BYTES = 4096  # of the bag header and its padding, without the length of either
_COMPRESSORS = {'lz4': ros1_lz4, 'bz2': bz2.compress}

_NS_PER_S = 10**9
_UINT32 = struct.Struct('<I').pack
_UINT64 = struct.Struct('<Q').pack
_COUNT = struct.Struct('<II').pack
_ENTRY = struct.Struct('<III').pack
_MESSAGE_HEAD = struct.Struct('<II4sI5sII5sIII').pack


def ros1_channel(channel: Channel, types: Ros1Types) -> Ros1Channel:
    """Return the connection that a channel of ROS 2 becomes.

    Raises:
        Exception: Its type cannot be written.
    """
    msgtype = types.name(channel.msgtype)
    definition, md5sum = types.definition(msgtype)
    return Ros1Channel(
        channel.topic,
        msgtype,
        'ros1',
        definition,
        'ros1msg',
        md5sum,
        CALLER,
        latched=channel.latched,
        depth=channel.depth,
    )


def _fields(fields: Mapping[str, bytes]) -> bytes:
    return b''.join(
        _UINT32(len(name) + 1 + len(value)) + name.encode() + b'=' + value
        for name, value in fields.items()
    )


def _record_head(opcode: int, data_bytes: int, **fields: bytes) -> bytes:
    header = _fields({'op': bytes([opcode]), **fields})
    return _UINT32(len(header)) + header + _UINT32(data_bytes)


def _record(opcode: int, data: bytes, **fields: bytes) -> bytes:
    return _record_head(opcode, len(data), **fields) + data


def _time(stamp_ns: int) -> bytes:
    return _COUNT(*divmod(stamp_ns, _NS_PER_S))


def _connection(channel_id: int, channel: Ros1Channel) -> bytes:
    described = {
        'topic': channel.topic.encode(),
        'type': denormalize_msgtype(channel.msgtype).encode(),
        'md5sum': channel.md5sum.encode(),
        'message_definition': channel.definition.encode(),
    }
    if channel.callerid is not None:
        described['callerid'] = channel.callerid.encode()
    described['latching'] = b'%d' % channel.latched
    topic = channel.topic.encode()
    return _record(CONNECTION, _fields(described), conn=_UINT32(channel_id), topic=topic)


def _bag_header(index_position: int, connections: int, chunks: int) -> bytes:
    """Return the record of the bag header; the recorder's first one has zeros only."""
    fields = {
        'index_pos': _UINT64(index_position),
        'conn_count': _UINT32(connections),
        'chunk_count': _UINT32(chunks),
    }
    padding = _HEADER_BYTES - (len(_record_head(BAG_HEADER, 0, **fields)) - 8)
    return _record(BAG_HEADER, b' ' * padding, **fields)


class _Ros1Chunk(ChunkContents[bytes]):
    """The contents of a chunk; its entry is the record of its summary."""

    __slots__ = ()

    def is_full(self) -> bool:
        """Return whether the chunk has its size."""
        return self.size > _CHUNK_BYTES

    def message_head(self, channel_id: int, sequence: int, stamp_ns: int, size: int) -> bytes:
        """Return the bytes that precede a message of a size, as _record_head does."""
        del sequence  # messages are not numbered
        time = divmod(stamp_ns, _NS_PER_S)
        conn = 9, b'conn=', channel_id
        return _MESSAGE_HEAD(38, 4, b'op=%c' % MESSAGE, *conn, 13, b'time=', *time, size)

    def open_head(self) -> bytes:
        """Return the head of a chunk that its recorder did not finish, as ROS 1 writes it."""
        return _record_head(CHUNK, 0, compression=b'none', size=bytes(4))

    def head(self, compression: str, stored: int) -> bytes:
        """Return the chunk up to its records, which are stored in so many bytes."""
        name = (compression or 'none').encode()
        return _record_head(CHUNK, stored, compression=name, size=_UINT32(self.size))

    def finish(
        self, compression: str, start: int, position: int, stored: int
    ) -> tuple[bytes, bytes]:
        """Return the indexes that follow the chunk, and the record of its summary."""
        del compression, position, stored
        indexes, counts = bytearray(), bytearray()
        for channel_id, entries in self.index.items():
            pairs = zip(entries[::2], entries[1::2], strict=True)
            data = b''.join(_ENTRY(*divmod(stamp_ns, _NS_PER_S), at) for stamp_ns, at in pairs)
            count = len(entries) // 2
            of = {'ver': _UINT32(1), 'conn': _UINT32(channel_id), 'count': _UINT32(count)}
            indexes += _record(INDEX, data, **of)
            counts += _COUNT(channel_id, count)
        start_ns, end_ns = self.span()
        summary = _record(
            CHUNK_INFO,
            bytes(counts),
            ver=_UINT32(1),
            chunk_pos=_UINT64(start),
            start_time=_time(start_ns),
            end_time=_time(end_ns),
            count=_UINT32(len(self.index)),
        )
        return bytes(indexes), summary


class Ros1FileWriter:
    """The writer of one .bag file."""

    def __init__(self, path: Path, context: WriterContext) -> None:
        self._types = Ros1Types(context.typestore)
        self._channels: list[Ros1Channel] = []
        self._converters: list[Convert | None] = []
        self._file = UnbufferedFile(path)
        name = context.options.compression
        self._chunks: Chunks[bytes] = StreamedChunks(self._file, _Ros1Chunk)
        if name != 'none':
            compress = _COMPRESSORS[name]
            self._chunks = CompressedChunks(self._file, _Ros1Chunk, name, compress, context.threads)
        try:
            self._file.write([MAGIC, _bag_header(0, 0, 0)])
        except BaseException:
            self.abort()
            raise

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Write the connection's record, unchanged if it is copied from another ROS 1 bag."""
        convert = None
        if not isinstance(channel, Ros1Channel):
            convert = self._types.converter(channel.msgtype)
            channel = ros1_channel(channel, self._types)
        self._channels.append(channel)
        self._converters.append(convert)
        self._chunks.add_inside(_connection(channel_id, channel))

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message, converted unless it is copied from another ROS 1 bag."""
        convert = self._converters[channel_id]
        if convert is not None:
            parts = convert(parts)
        self._chunks.add(channel_id, 0, stamp_ns, parts)

    def close(self, information: bytes) -> None:
        """Write the last chunk and the index."""
        del information  # the format cannot store it
        summaries = self._chunks.finish()
        position = self._file.position
        for channel_id, channel in enumerate(self._channels):
            self._file.write([_connection(channel_id, channel)])
        self._file.write(summaries)
        header = _bag_header(position, len(self._channels), len(summaries))
        self._file.write_at(len(MAGIC), header)
        self._file.close()

    def abort(self) -> None:
        """Stop all threads and close the file."""
        self._chunks.cancel()
        self._file.close()
