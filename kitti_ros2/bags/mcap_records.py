# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file, one after the other, and what follows those that are damaged.

mcap_chunk says how records are laid out. A record is believed when its own lengths agree and what
follows it looks like a record too; else the bytes after it are searched for where three such
records follow each other. In a chunk that is not compressed these may be its messages: they are
records as well, so a damaged head costs nothing but itself.
"""

from __future__ import annotations

import re
import struct
from enum import Enum
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple, Protocol

from mcap.opcode import Opcode

from .decompressors import UNCOMPRESSED, decompress

try:
    from isal.isal_zlib import crc32  # zlib's CRC at many times its speed
except ImportError:  # a workspace may do without
    from zlib import crc32

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from .pieces import Buffer, StoredMessage

    class Source(Protocol):
        """Bytes by position."""

        @property
        def size(self) -> int: ...
        def read(self, position: int, length: int) -> Buffer: ...


RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQHIQQ')
MESSAGE_BODY = struct.Struct('<HIQQ')
_CHUNK = struct.Struct('<QQQII')
_INDEX = struct.Struct('<HI')
_LENGTH = struct.Struct('<Q')
_LOOKED_AT = RECORD_HEAD.size + 64
_LONGEST_NAME = 16  # of a compression
_WINDOW = 2**20
_CANDIDATE = re.compile(rb'(?=[\x03-\x0f].{5}\0\0\0)', re.DOTALL)
_FIXED = {Opcode.FOOTER: 20, Opcode.DATA_END: 4}


class Record(NamedTuple):
    """Where a record is: opcode, position of its head, position after its body."""

    opcode: int
    position: int
    end: int


class ChunkHead(NamedTuple):
    """What a chunk says of itself; records_at counts from the record's head."""

    size: int
    crc: int
    compression: str
    records_at: int
    records_size: int


class Kind(Enum):
    """What stands at a position."""

    WHOLE = 'a record'
    CUT = 'a record that goes beyond the end'
    NONE = 'no record'


def parse_chunk_head(record: Buffer) -> ChunkHead:
    """The head of a chunk, from its record.

    Raises:
        ValueError: It is damaged or cut.
    """
    at = RECORD_HEAD.size
    try:
        _, _, size, crc, name_length = _CHUNK.unpack_from(record, at)
        at += _CHUNK.size
        if name_length > _LONGEST_NAME:
            raise ValueError('its head is damaged')
        name = bytes(record[at : at + name_length]).decode('ascii')
        (stored,) = _LENGTH.unpack_from(record, at + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError('its head is damaged') from error
    if name in UNCOMPRESSED and size != stored:
        raise ValueError('its head is damaged')
    return ChunkHead(size, crc, name, at + name_length + _LENGTH.size, stored)


def unpack_chunk(record: Buffer) -> Buffer:
    """The records in a chunk.

    Raises:
        ValueError: It is damaged.
    """
    head = parse_chunk_head(record)
    stored = memoryview(record)[head.records_at : head.records_at + head.records_size]
    records = decompress(head.compression, stored, head.size)
    if head.crc and crc32(records) != head.crc:
        raise ValueError('wrong checksum')
    return records


def messages_in(
    records: Buffer, wanted: Collection[int], since_ns: int
) -> tuple[list[StoredMessage], int]:
    """The messages of some channels among records, by stamp, and where the last record ends."""
    view = memoryview(records)
    found: list[StoredMessage] = []
    position, end = 0, len(view)
    head_size, message_size, unpack = RECORD_HEAD.size, _MESSAGE.size, _MESSAGE.unpack_from
    last_ns, sort = -1, False
    while end - position >= message_size:
        opcode, length, channel_id, _, stamp_ns, _ = unpack(view, position)
        following: int = position + head_size + length
        if following > end:
            break
        if opcode == Opcode.MESSAGE and channel_id in wanted and stamp_ns >= since_ns:
            found.append((stamp_ns, channel_id, view[position + message_size : following]))
            sort = sort or stamp_ns < last_ns
            last_ns = stamp_ns
        position = following
    if sort:
        found.sort(key=itemgetter(0))
    return found, position


def look(source: Source, position: int, end: int) -> tuple[Kind, Record]:
    """What stands at a position, by its head and the lengths inside it."""
    head = source.read(position, _LOOKED_AT)
    if len(head) < RECORD_HEAD.size:
        return Kind.CUT, Record(0, position, end + 1)
    opcode, length = RECORD_HEAD.unpack_from(head)
    record = Record(opcode, position, position + RECORD_HEAD.size + length)
    if not 0 < opcode <= Opcode.DATA_END and opcode < 0x80:
        return Kind.NONE, record
    if not _agrees(opcode, length, head):
        return Kind.NONE, record
    return (Kind.WHOLE if record.end <= end else Kind.CUT), record


def _agrees(opcode: int, length: int, head: Buffer) -> bool:
    """Whether the lengths inside a record agree with its own."""
    if opcode in _FIXED:
        return length == _FIXED[Opcode(opcode)]
    if opcode == Opcode.MESSAGE:
        return length >= MESSAGE_BODY.size
    if opcode == Opcode.MESSAGE_INDEX and len(head) >= RECORD_HEAD.size + _INDEX.size:
        return bool(_INDEX.unpack_from(head, RECORD_HEAD.size)[1] == length - _INDEX.size)
    if opcode == Opcode.CHUNK and len(head) == _LOOKED_AT:
        try:
            chunk = parse_chunk_head(head)
        except ValueError:
            return False
        return chunk.records_at + chunk.records_size == RECORD_HEAD.size + length
    return True


def walk(
    source: Source, position: int, end: int, lose: Callable[[int, int], None]
) -> Iterator[Record]:
    """The records from a position on, the last one perhaps cut; damaged bytes are passed over.

    Args:
        source: The bytes.
        position: Where the first record begins.
        end: Where the last one ends.
        lose: Told from where to where bytes are damaged.
    """
    while position < end:
        kind, record = look(source, position, end)
        if kind is Kind.WHOLE and _is_followed(source, record, end):
            yield record
            position = record.end
            continue
        found = find_record(source, position + 1, end)
        if kind is Kind.WHOLE and (found is None or found >= record.end):
            # No record within it: it is the next one that is damaged.
            yield record
            position = record.end
            if position < end and look(source, position, end)[0] is Kind.CUT:
                continue
        elif kind is Kind.CUT and found is None:
            yield record
            return
        if found is None:
            if position < end:
                lose(position, end)
            return
        if position < found:
            lose(position, found)
        position = found


def _is_followed(source: Source, record: Record, end: int) -> bool:
    if record.end == end or record.opcode == Opcode.FOOTER:
        return True
    return look(source, record.end, end)[0] is Kind.WHOLE


def find_record(source: Source, position: int, end: int) -> int | None:
    """The first position from which on records follow each other, None where there is none."""
    while position < end:
        window = source.read(position, min(_WINDOW, end - position) + RECORD_HEAD.size)
        for match in _CANDIDATE.finditer(window):
            if _begins_row(source, position + match.start(), end):
                return position + match.start()
        position += _WINDOW
    return None


def _begins_row(source: Source, position: int, end: int) -> bool:
    for number in range(3):
        kind, record = look(source, position, end)
        if kind is not Kind.WHOLE or record.opcode > Opcode.DATA_END:
            return kind is Kind.CUT and number > 1
        if record.end == end:
            return True
        position = record.end
    return True
