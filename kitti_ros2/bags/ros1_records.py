# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of the records of a ROS 1 .bag file (http://wiki.ros.org/Bags/Format/2.0).

Little endian; every record is a header's length (uint32), the header, the data's length (uint32)
and the data. A header is a sequence of fields, each its length (uint32) and ``name=value``; the
field op is the record's kind. Messages are in chunks; each chunk is followed by the indexes of its
messages; the file ends with all connections and the summaries of the chunks.
"""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from .decompressors import UNCOMPRESSED, decompress, decompress_beginning
from .limits import largest_block
from .record_walk import Kind, Record

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from .pieces import Buffer, StoredMessage
    from .record_walk import Source

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = range(2, 8)
MAGIC = b'#ROSBAG V2.0\n'

Fields: TypeAlias = 'dict[bytes, bytes]'
"""Of the header of a record, by name."""

_UINT32 = struct.Struct('<I')
_TIME = struct.Struct('<II')
_LONGEST_HEADER = 2**16
_HEAD_READ = 256
# The required fields of each kind of record with their sizes, and the data size per count.
_NEEDED: dict[int, dict[bytes, int | None]] = {
    MESSAGE: {b'conn': 4, b'time': 8},
    BAG_HEADER: {b'index_pos': 8, b'conn_count': 4, b'chunk_count': 4},
    INDEX: {b'ver': 4, b'conn': 4, b'count': 4},
    CHUNK: {b'compression': None, b'size': 4},
    CHUNK_INFO: {b'ver': 4, b'chunk_pos': 8, b'start_time': 8, b'end_time': 8, b'count': 4},
    CONNECTION: {b'conn': 4, b'topic': None},
}
_ENTRY_SIZES = {INDEX: 12, CHUNK_INFO: 8}

# A message's header as recorders write it, with its fields in any order, and its data's length.
_MESSAGE_HEAD = re.compile(
    rb'\x26\0\0\0(?:\x09\0\0\0conn=(.{4})|\x04\0\0\0op=\x02|\x0d\0\0\0time=(.{8})){3}(.{4})',
    re.DOTALL,
)
# The first field of any record that a search may begin with: chunks, messages, connections.
_FIELD = (
    rb'(?:\x04\0\0\0op=|.\0\0\0compression=|\x09\0\0\0(?:conn|size)=|\x0d\0\0\0time=|...\0topic=)'
)


def parse_time(value: Buffer) -> int:
    """Return a time in nanoseconds."""
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds) * 10**9 + int(nanoseconds)


def parse_fields(header: Buffer) -> Fields:
    """Parse the fields of a header, by name.

    Raises:
        ValueError: The header is invalid.
    """
    data = bytes(header)
    fields = {}
    position = 0
    while position < len(data):
        if position + 4 > len(data):
            raise ValueError('a field is cut')
        (size,) = _UINT32.unpack_from(data, position)
        position += 4
        name, equals, value = data[position : position + size].partition(b'=')
        position += size
        if not equals or position > len(data):
            raise ValueError('a field is cut')
        fields[name] = value
    return fields


def split_record(view: Buffer, position: int) -> tuple[Fields, int, int]:
    """Return a record's header fields, and the start and end of its data, which may be truncated.

    Raises:
        ValueError: The header is invalid or truncated.
    """
    if position + 4 > len(view):
        raise ValueError('cut')
    (size,) = _UINT32.unpack_from(view, position)
    start = position + 4 + size
    if size > _LONGEST_HEADER:
        raise ValueError('no header')
    if start + 4 > len(view):
        raise ValueError('cut')
    fields = parse_fields(view[position + 4 : start])
    (length,) = _UINT32.unpack_from(view, start)
    return fields, start + 4, start + 4 + int(length)


def split_records(view: Buffer) -> Iterator[tuple[Fields, int, int]]:
    """Yield consecutive records, up to the first damaged one."""
    position = 0
    while position < len(view):
        try:
            fields, start, position = split_record(view, position)
        except ValueError:
            return
        if position > len(view) or not opcode_of(fields):
            return
        yield fields, start, position


def opcode_of(fields: Fields) -> int:
    """Return the kind of a record, 0 if its fields are invalid."""
    opcode = int.from_bytes(fields.get(b'op', b'\0'), 'little')
    for name, size in _NEEDED.get(opcode, {b'': None}).items():
        if name not in fields or (size is not None and len(fields[name]) != size):
            return 0
    return opcode


def messages_in(
    records: Buffer,
    wanted: Collection[int],
    since_ns: int,
    describe: Callable[[Fields, Buffer], None],
) -> tuple[list[StoredMessage], int]:
    """Return the messages of some connections, and the end of the last record that can be split.

    Args:
        records: The records of a chunk.
        wanted: Ids of the requested connections.
        since_ns: The first requested stamp.
        describe: Called with header and data of each connection record.
    """
    view = memoryview(records)
    found: list[StoredMessage] = []
    position, end = 0, len(view)
    match_head = _MESSAGE_HEAD.match
    while position < end:
        head = match_head(view, position)
        if head is not None:
            conn, time, size = head.groups()
            start = head.end()
            following = start + int.from_bytes(size, 'little')
            if conn is None or time is None or following > end:
                break
            channel_id = int.from_bytes(conn, 'little')
            if channel_id in wanted and (stamp_ns := parse_time(time)) >= since_ns:
                found.append((stamp_ns, channel_id, view[start:following]))
            position = following
            continue
        record = _record_at(view, position)
        if record is None:
            break
        fields, start, following = record
        if opcode_of(fields) == MESSAGE:
            channel_id, stamp_ns = parse_message(fields)
            if channel_id in wanted and stamp_ns >= since_ns:
                found.append((stamp_ns, channel_id, view[start:following]))
        elif opcode_of(fields) == CONNECTION:
            describe(fields, view[start:following])
        position = following
    return found, position


def _record_at(view: memoryview, position: int) -> tuple[Fields, int, int] | None:
    """Return the record at a position as split_record does; None unless it is whole."""
    try:
        fields, start, following = split_record(view, position)
    except ValueError:
        return None
    return (fields, start, following) if opcode_of(fields) and following <= len(view) else None


class _Chunk(NamedTuple):
    """A chunk: the size of its records, and where they are stored in it."""

    compression: str
    size: int
    start: int
    end: int


def _parse_chunk(data: Buffer) -> _Chunk | None:
    """Parse the head of a chunk; None if data begin with another record."""
    try:
        fields, start, end = split_record(data, 0)
    except ValueError:
        return None
    if opcode_of(fields) != CHUNK:
        return None
    compression = fields[b'compression'].decode('ascii', 'replace')
    return _Chunk(compression, _UINT32.unpack(fields[b'size'])[0], start, end)


def parse_message(fields: Fields) -> tuple[int, int]:
    """Return the connection and stamp of a message."""
    return int.from_bytes(fields[b'conn'], 'little'), parse_time(fields[b'time'])


class Ros1Format:
    """The record format of ROS 1 bags; the head of a record is its header's fields."""

    start = len(MAGIC)
    chunk = CHUNK
    message = MESSAGE
    longest_message_head = _HEAD_READ
    candidate = re.compile(rb'(?=..\0\0' + _FIELD + rb')', re.DOTALL)
    longest = 32
    row = 1  # names of fields are no coincidence

    def look(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """Classify the bytes at a position."""
        head = source.read(position, min(_HEAD_READ, end - position))
        size = int.from_bytes(head[:4], 'little')
        if size > _LONGEST_HEADER:
            return Kind.NONE, Record(0, position, position)
        needed = 4 + size + 4
        if needed > len(head):
            head = source.read(position, min(needed, end - position))
        if needed > len(head):
            return Kind.CUT, Record(0, position, end + 1)
        try:
            fields, start, stop = split_record(head, 0)
        except ValueError:
            return Kind.NONE, Record(0, position, position)
        record = Record(opcode_of(fields), position, position + stop)
        if not _agrees(record.opcode, fields, stop - start):
            return Kind.NONE, record
        unset = record.opcode == CHUNK and fields[b'size'] == bytes(4)
        if unset and not _begins_after_chunk(source.read(record.end, _HEAD_READ)):
            # A chunk that its recorder did not finish extends to the end.
            record = record._replace(end=end + 1)
        return (Kind.WHOLE if record.end <= end else Kind.CUT), record

    def is_checked(self, opcode: int) -> bool:
        """Whether records of an opcode contain a second length."""
        return opcode in _ENTRY_SIZES

    def inside(self, source: Source, position: int) -> int | None:
        """Return the position of a chunk's first record, None if the chunk is compressed."""
        fields, start, _ = split_record(source.read(position, _HEAD_READ), 0)
        return position + start if fields[b'compression'] == b'none' else None

    def compression(self, record: Buffer) -> str:
        """Return the name of a chunk's compression."""
        return split_record(record, 0)[0][b'compression'].decode('ascii', 'replace')

    def unpacked_size(self, data: Buffer) -> int:
        """Return the most bytes that unpack makes of a piece."""
        chunk = _parse_chunk(data)
        if chunk is None:
            return len(data)
        # decompress_beginning is bounded by the same where the size is not known.
        return chunk.size or largest_block(len(data))

    def unpack(self, data: Buffer) -> tuple[Buffer, bool]:
        """Return the records of a piece, and whether it is whole."""
        chunk = _parse_chunk(data)
        if chunk is None:
            return data, True
        compression, size, start, end = chunk
        stored = memoryview(data)[start:]
        if size == 0 or end - start > len(stored):
            # Recorders write the size once the chunk is full.
            return decompress_beginning(compression, stored, size), False
        return decompress(compression, stored[: end - start], size), True

    split_record = staticmethod(split_record)
    split_records = staticmethod(split_records)

    def stored_message(self, head: Fields, body: memoryview) -> StoredMessage | None:
        """Return the message that a record is, None for others."""
        if opcode_of(head) != MESSAGE:
            return None
        channel_id, stamp_ns = parse_message(head)
        return stamp_ns, channel_id, body


def _begins_after_chunk(head: Buffer) -> bool:
    """Whether a record begins that is behind a chunk, never in it: then the chunk is empty."""
    try:
        return opcode_of(split_record(head, 0)[0]) in {CHUNK, INDEX, CHUNK_INFO}
    except ValueError:
        return False


def _agrees(opcode: int, fields: Fields, length: int) -> bool:
    """Whether the opcode is known and the header agrees with the data's length."""
    if opcode in _ENTRY_SIZES:
        (count,) = _UINT32.unpack(fields[b'count'])
        return bool(length == count * _ENTRY_SIZES[opcode])
    if opcode == CHUNK and fields[b'compression'].decode('ascii', 'replace') in UNCOMPRESSED:
        return bool(length == _UINT32.unpack(fields[b'size'])[0])
    return opcode != 0


ROS1 = Ros1Format()
