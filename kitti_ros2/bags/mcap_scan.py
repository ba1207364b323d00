# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file read from its start, record by record, as far as it goes.

This needs neither summary nor footer: it reads what a recorder left that was cut off. A chunk that
is damaged is passed over and said aloud.
"""

from __future__ import annotations

import heapq
import struct
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING, BinaryIO
from zlib import crc32

import zstandard
from lz4 import frame as lz4_frame
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from kitti_ros2.errors import BadBagError

from .mcap_summary import MAGIC
from .summary import BagIndex

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE_HEAD = struct.Struct('<HIQQ')
_READ_WHOLE = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK, Opcode.MESSAGE}


@dataclass
class McapScan:
    """What a pass over a file found.

    Attributes:
        path: The file.
        complete: Whether the file ended as it should and every chunk was sound.
        warnings: What was wrong, one line each.
        schemas, channels: By id.
        units: Chunks and lone messages: least stamp, position and length in the file.
        stamps: Nanoseconds by channel id.
        compressions: Names of the compressions met.
    """

    path: Path
    complete: bool = False
    warnings: list[str] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    units: list[tuple[int, int, int]] = field(default_factory=list)
    stamps: dict[int, list[int]] = field(default_factory=dict)
    compressions: set[str] = field(default_factory=set)

    def msgtype(self, channel: Channel) -> str:
        """The type of a channel's messages, empty where the file does not tell."""
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else ''

    def index(self) -> BagIndex:
        """The stamps by topic."""
        index = BagIndex(
            complete=self.complete, warnings=list(self.warnings), compressions=self.compressions
        )
        for channel in self.channels.values():
            index.add((channel.topic, self.msgtype(channel)), self.stamps.get(channel.id, []))
        return index


def scan_mcap(path: Path) -> McapScan:
    """Pass over a file once.

    Raises:
        BadBagError: The file does not begin as an MCAP file does.
        OSError: The file cannot be read.
    """
    scan = McapScan(path)
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise BadBagError(path, 'does not begin as an MCAP file does')
        read = 'what comes before'
        try:
            for position, opcode, body in _records(file):
                if opcode == Opcode.FOOTER:
                    scan.complete = not scan.warnings
                    return scan
                if opcode == Opcode.DATA_END:
                    read = 'every message'
                _enter(scan, position, opcode, body)
        except (EOFError, McapError, struct.error, UnicodeDecodeError) as error:
            scan.warnings.append(f'{path}: {error}; {read} was read')
    return scan


def scanned_messages(scan: McapScan) -> Iterator[tuple[Channel, int, bytes]]:
    """The messages of a scanned file (channel, stamp in ns, data) in time order.

    Raises:
        OSError: The file cannot be read.
    """
    waiting: list[tuple[int, int, int, bytes]] = []
    order = 0
    with scan.path.open('rb') as file:
        for start_ns, position, length in sorted(scan.units):
            while waiting and waiting[0][0] < start_ns:
                stamp_ns, _, channel_id, data = heapq.heappop(waiting)
                yield scan.channels[channel_id], stamp_ns, data
            file.seek(position)
            body = file.read(length)
            for opcode, record in _inner_records(scan, body[0], body[_RECORD_HEAD.size :]):
                if opcode != Opcode.MESSAGE:
                    continue
                channel_id, _, stamp_ns, _ = _MESSAGE_HEAD.unpack_from(record)
                if channel_id in scan.channels:
                    message = bytes(record[_MESSAGE_HEAD.size :])
                    heapq.heappush(waiting, (stamp_ns, order, channel_id, message))
                    order += 1
    while waiting:
        stamp_ns, _, channel_id, data = heapq.heappop(waiting)
        yield scan.channels[channel_id], stamp_ns, data


def _records(file: BinaryIO) -> Iterator[tuple[int, int, bytes]]:
    position = file.tell()
    size = file.seek(0, 2)
    while True:
        file.seek(position)
        head = file.read(_RECORD_HEAD.size)
        if len(head) < _RECORD_HEAD.size:
            raise EOFError(f'cut off at byte {size}')
        opcode, length = _RECORD_HEAD.unpack(head)
        end = position + len(head) + length
        if end > size:
            raise EOFError(f'cut off at byte {size}, in the record at {position}')
        yield position, opcode, file.read(length) if opcode in _READ_WHOLE else b''
        position = end


def _enter(scan: McapScan, position: int, opcode: int, body: bytes) -> None:
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(body)))
        scan.schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(ReadDataStream(BytesIO(body)))
        scan.channels[channel.id] = channel
    elif opcode in {Opcode.CHUNK, Opcode.MESSAGE}:
        _enter_messages(scan, position, opcode, body)


def _enter_messages(scan: McapScan, position: int, opcode: int, body: bytes) -> None:
    try:
        records = list(_inner_records(scan, opcode, body))
    except (ValueError, RuntimeError, zstandard.ZstdError) as error:
        scan.warnings.append(f'{scan.path}: the chunk at byte {position} is damaged ({error})')
        return
    start_ns = None
    for inner, data in records:
        if inner == Opcode.MESSAGE:
            channel_id, _, stamp_ns, _ = _MESSAGE_HEAD.unpack_from(data)
            scan.stamps.setdefault(channel_id, []).append(stamp_ns)
            start_ns = stamp_ns if start_ns is None else min(start_ns, stamp_ns)
        else:
            _enter(scan, position, inner, bytes(data))
    if start_ns is not None:
        scan.units.append((start_ns, position, _RECORD_HEAD.size + len(body)))


def _inner_records(scan: McapScan, opcode: int, body: bytes) -> Iterator[tuple[int, memoryview]]:
    if opcode != Opcode.CHUNK:
        yield opcode, memoryview(body)
        return
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    scan.compressions.add(chunk.compression)
    yield from _split_records(_uncompressed(chunk))


def _split_records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    view = memoryview(data)
    position = 0
    while position < len(view):
        if len(view) - position < _RECORD_HEAD.size:
            raise ValueError('a record in it is cut')
        opcode, length = _RECORD_HEAD.unpack_from(view, position)
        position += _RECORD_HEAD.size
        if length > len(view) - position:
            raise ValueError('a record in it is cut')
        yield opcode, view[position : position + length]
        position += length


def _uncompressed(chunk: Chunk) -> bytes:
    data = chunk.data
    if chunk.compression == 'zstd':
        data = zstandard.ZstdDecompressor().decompress(data, chunk.uncompressed_size)
    elif chunk.compression == 'lz4':
        data = lz4_frame.decompress(data)
    elif chunk.compression:
        raise ValueError(f'unknown compression {chunk.compression!r}')
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f'{len(data)} bytes instead of {chunk.uncompressed_size}')
    if chunk.uncompressed_crc and crc32(data) != chunk.uncompressed_crc:
        raise ValueError('wrong checksum')
    return data
