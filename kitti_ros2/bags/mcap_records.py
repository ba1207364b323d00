# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of the records of an MCAP file; their layouts are documented in mcap_chunk."""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING, NamedTuple

from mcap.opcode import Opcode

from ..files.checksums import crc32
from .decompressors import UNCOMPRESSED, decompress, decompress_beginning
from .mcap_summary import MAGIC
from .pieces import Piece
from .record_walk import DamagedHeadError, Kind, Record

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from .pieces import Buffer, StoredMessage
    from .record_walk import Source

RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQHIQQ')
MESSAGE_BODY = struct.Struct('<HIQQ')
_SHORTEST = MESSAGE_BODY.size
_CHUNK = struct.Struct('<QQQII')
INDEX_BODY = struct.Struct('<HI')
_LENGTH = struct.Struct('<Q')
# Chunk Index: start and end time, place and length of the chunk, bytes of the entries that follow
# (channel, place of its message index); then the length of all message indexes, the compression.
_CHUNK_INDEX = struct.Struct('<QQQQI')
_CHUNK_INDEX_ENTRY = struct.Struct('<HQ')
_INDEX_LENGTHS = struct.Struct('<QI')
_ENTRY_SIZE = 16  # of a message index: stamp, offset
_LOOKED_AT = RECORD_HEAD.size + 64
_LONGEST_NAME = 16  # of a compression
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_FIRST_PRIVATE = 0x80
# The least length of each record's body in bytes: that of an empty one.
_LEAST: dict[int, int] = {
    Opcode.HEADER: 8,
    Opcode.FOOTER: 20,
    Opcode.SCHEMA: 14,
    Opcode.CHANNEL: 16,
    Opcode.MESSAGE: 22,
    Opcode.CHUNK: 40,
    Opcode.MESSAGE_INDEX: 6,
    Opcode.CHUNK_INDEX: 64,
    Opcode.ATTACHMENT: 36,
    Opcode.ATTACHMENT_INDEX: 48,
    Opcode.STATISTICS: 46,
    Opcode.METADATA: 8,
    Opcode.METADATA_INDEX: 20,
    Opcode.SUMMARY_OFFSET: 17,
    Opcode.DATA_END: 4,
}
_FIXED = {Opcode.FOOTER, Opcode.SUMMARY_OFFSET, Opcode.DATA_END}
# Records with inner lengths that must agree.
_CHECKED = {*_FIXED, Opcode.CHUNK, Opcode.MESSAGE_INDEX}


class ChunkHead(NamedTuple):
    """The head of a chunk; records_at is relative to the start of the chunk record."""

    size: int
    crc: int
    compression: str
    records_at: int
    records_size: int


def parse_chunk_head(record: Buffer) -> ChunkHead:
    """Parse the head of a chunk from its record.

    Raises:
        DamagedHeadError: The head is damaged or truncated.
    """
    at = RECORD_HEAD.size
    try:
        _, _, size, crc, name_length = _CHUNK.unpack_from(record, at)
        at += _CHUNK.size
        if name_length > _LONGEST_NAME:
            raise DamagedHeadError
        name = bytes(record[at : at + name_length]).decode('ascii')
        (stored,) = _LENGTH.unpack_from(record, at + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        raise DamagedHeadError from error
    if name in UNCOMPRESSED and size != stored:
        raise DamagedHeadError
    return ChunkHead(size, crc, name, at + name_length + _LENGTH.size, stored)


def parse_chunk_index(body: Buffer) -> tuple[Piece, str, int]:
    """Parse a Chunk Index record: the chunk, its compression, the bytes of its message indexes.

    Raises:
        ValueError, struct.error: The record is damaged.
    """
    start_ns, end_ns, position, length, size = _CHUNK_INDEX.unpack_from(body)
    after = _CHUNK_INDEX.size + size
    index_length, name_length = _INDEX_LENGTHS.unpack_from(body, after)
    after += _INDEX_LENGTHS.size
    name = bytes(body[after : after + name_length]).decode()
    entries = _CHUNK_INDEX_ENTRY.iter_unpack(body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size])
    starts = sorted((start, key) for key, start in entries)
    end = position + length + index_length
    head = RECORD_HEAD.size + INDEX_BODY.size
    counts = {}
    for start, key in reversed(starts):
        counts[key] = (end - start - head) // _ENTRY_SIZE
        end = start
    return Piece(start_ns, end_ns, position, length, counts), name, index_length


def agrees(data: Buffer, crc: int) -> bool:
    """Whether bytes match a checksum; 0 means that there is none."""
    return crc in (0, crc32(data))


def split_records(records: Buffer) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the body of consecutive records, up to a damaged one."""
    view = memoryview(records)
    position, end = 0, len(view)
    while end - position >= RECORD_HEAD.size:
        opcode, length = RECORD_HEAD.unpack_from(view, position)
        following = position + RECORD_HEAD.size + length
        if following > end or opcode == 0 or (opcode == _MESSAGE_OPCODE and length < _SHORTEST):
            return
        yield opcode, position + RECORD_HEAD.size, following
        position = following


def messages_in(
    records: Buffer,
    wanted: Collection[int],
    since_ns: int,
    describe: Callable[[int, Buffer], None],
) -> tuple[list[StoredMessage], int]:
    """Return the messages of some channels, and the end of the last record that can be split.

    Args:
        records: The records of a chunk.
        wanted: Ids of the requested channels.
        since_ns: The first requested stamp.
        describe: Called with opcode and body of each record that is no message.
    """
    view = memoryview(records)
    found: list[StoredMessage] = []
    position, end = 0, len(view)
    head_size, message_size, unpack = RECORD_HEAD.size, _MESSAGE.size, _MESSAGE.unpack_from
    # The same as split_records; inlined because reading spends its time here.
    while end - position >= message_size:
        opcode, length, channel_id, _, stamp_ns, _ = unpack(view, position)
        following = position + head_size + length
        if following > end or opcode == 0 or (opcode == _MESSAGE_OPCODE and length < _SHORTEST):
            return found, position
        if opcode != _MESSAGE_OPCODE:
            describe(opcode, view[position + head_size : following])
        elif channel_id in wanted and stamp_ns >= since_ns:
            found.append((stamp_ns, channel_id, view[position + message_size : following]))
        position = following
    rest = position
    for opcode, start, following in split_records(view[rest:]):
        describe(opcode, view[rest + start : rest + following])
        position = rest + following
    return found, position


class McapFormat:
    """The record format of MCAP; the head of a record is its opcode."""

    start = len(MAGIC)
    chunk = int(Opcode.CHUNK)
    message = _MESSAGE_OPCODE
    longest_message_head = _MESSAGE.size
    candidate = re.compile(rb'(?=[\x03-\x0f].{5}\0\0\0)', re.DOTALL)
    longest = RECORD_HEAD.size
    row = 3

    def look(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """Classify the bytes at a position."""
        head = source.read(position, min(_LOOKED_AT, end - position))
        if len(head) < RECORD_HEAD.size:
            return Kind.CUT, Record(0, position, end + 1)
        opcode, length = RECORD_HEAD.unpack_from(head)
        record = Record(opcode, position, position + RECORD_HEAD.size + length)
        if not _agrees(opcode, length, head):
            return Kind.NONE, record
        return (Kind.WHOLE if record.end <= end else Kind.CUT), record

    def is_checked(self, opcode: int) -> bool:
        """Whether records of an opcode contain a second length."""
        return opcode in _CHECKED

    def inside(self, source: Source, position: int) -> int | None:
        """Return the position of a chunk's first record, None if compressed or damaged."""
        try:
            head = parse_chunk_head(source.read(position, _LOOKED_AT))
        except DamagedHeadError:
            return None
        return position + head.records_at if head.compression in UNCOMPRESSED else None

    def compression(self, record: Buffer) -> str:
        """Return the name of a chunk's compression."""
        return parse_chunk_head(record).compression

    def unpacked_size(self, data: Buffer) -> int:
        """Return the most bytes that unpack makes of a piece."""
        return parse_chunk_head(data).size if data[:1] == _CHUNK_OPCODE else len(data)

    def unpack(self, data: Buffer) -> tuple[Buffer, bool]:
        """Return the records of a piece, and whether it is whole."""
        if data[:1] != _CHUNK_OPCODE:
            return data, True
        head = parse_chunk_head(data)
        stored = memoryview(data)[head.records_at : head.records_at + head.records_size]
        if len(stored) < head.records_size:
            return decompress_beginning(head.compression, stored, head.size), False
        records = decompress(head.compression, stored, head.size)
        if not agrees(records, head.crc):
            raise ValueError('wrong checksum')
        return records, True

    def split_record(self, view: Buffer, position: int) -> tuple[int, int, int]:
        """Return a record's opcode, and the start and end of its body."""
        opcode, length = RECORD_HEAD.unpack_from(view, position)
        start = position + RECORD_HEAD.size
        return opcode, start, start + length

    split_records = staticmethod(split_records)

    def stored_message(self, head: int, body: memoryview) -> StoredMessage | None:
        """Return the message that a record is, None for others."""
        if head != _MESSAGE_OPCODE:
            return None
        channel_id, _, stamp_ns, _ = MESSAGE_BODY.unpack_from(body)
        return stamp_ns, channel_id, body[MESSAGE_BODY.size :]


def _agrees(opcode: int, length: int, head: Buffer) -> bool:
    """Whether the opcode is known and the inner lengths agree with the record's."""
    if opcode not in _LEAST:
        return opcode >= _FIRST_PRIVATE
    if opcode in _FIXED:
        return length == _LEAST[opcode]
    if opcode == Opcode.MESSAGE_INDEX and len(head) >= RECORD_HEAD.size + INDEX_BODY.size:
        size = INDEX_BODY.unpack_from(head, RECORD_HEAD.size)[1]
        return bool(size == length - INDEX_BODY.size and size % 16 == 0)
    if opcode == Opcode.CHUNK and len(head) == _LOOKED_AT:
        try:
            chunk = parse_chunk_head(head)
        except DamagedHeadError:
            return False
        return chunk.records_at + chunk.records_size == RECORD_HEAD.size + length
    return length >= _LEAST[opcode]


MCAP = McapFormat()
