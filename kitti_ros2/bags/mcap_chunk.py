# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The chunks of an MCAP file being written: messages, their CRC and their indexes.

Record layouts (https://mcap.dev/spec), little endian; every record begins with opcode (uint8) and
length (uint64) of what follows:

- Message: channel (uint16), sequence (uint32), log time, publish time (uint64, ns), data.
- Chunk: start time, end time, uncompressed size (uint64), crc of the uncompressed records
  (uint32), compression (uint32 length, text), size of the records (uint64), records.
- Message Index: channel (uint16), size in bytes (uint32), then log time and offset in the
  uncompressed chunk (uint64) of each message.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING

from mcap.opcode import Opcode
from mcap.records import ChunkIndex

from ..files.checksums import crc32
from ..files.workers import OrderedPool
from .compressors import POOL_AHEAD, compressor

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..files.vectored import VectoredFile
    from ..options.bag import BagOptions
    from .contract import Parts

TARGET_SIZE = 4 * 2**20
# Below this size a copy costs less than one more buffer to pass on.
_COPIED_BELOW = 4096
_WRITTEN_FROM = 64 * 2**10

_pack_message = struct.Struct('<BQHIQQ').pack
_CHUNK_HEAD = struct.Struct('<BQQQQI')
_INDEX_HEAD = struct.Struct('<BQHI')


class _Contents:
    """Size, checksum and index of a chunk while it grows.

    Attributes:
        size: Bytes of the uncompressed records.
        crc: CRC-32 of those.
        index: Stamp and offset of each message, in one flat list by channel id.
    """

    __slots__ = ('crc', 'index', 'size')

    def __init__(self) -> None:
        self.size = 0
        self.crc = 0
        self.index: dict[int, list[int]] = {}

    def message_head(self, channel_id: int, sequence: int, stamp_ns: int, parts: Parts) -> bytes:
        """Enter a message, and return the bytes that precede its parts."""
        length = 22
        for part in parts:
            length += len(part)
        entries = self.index.get(channel_id)
        if entries is None:
            entries = self.index[channel_id] = []
        entries += (stamp_ns, self.size)
        self.size += 9 + length
        return _pack_message(5, length, channel_id, sequence, stamp_ns, stamp_ns)

    def span(self) -> tuple[int, int]:
        """Return the least and greatest stamp."""
        stamps = [entries[::2] for entries in self.index.values()]
        return min(map(min, stamps)), max(map(max, stamps))

    def head(self, compression: bytes, stored: int) -> bytes:
        """Return the chunk record up to the records in it."""
        length = 40 + len(compression) + stored
        head = _CHUNK_HEAD.pack(Opcode.CHUNK, length, *self.span(), self.size, self.crc)
        return head + struct.pack(f'<I{len(compression)}sQ', len(compression), compression, stored)

    def indexes(self, position: int) -> tuple[bytes, dict[int, int]]:
        """Return the message index records for a position, and the offset of each by channel id."""
        records = bytearray()
        offsets = {}
        for channel_id, entries in self.index.items():
            offsets[channel_id] = position + len(records)
            size = 8 * len(entries)
            records += _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            records += struct.pack(f'<{len(entries)}Q', *entries)
        return bytes(records), offsets

    def entry(
        self, start: int, compression: str, stored: int, indexes: bytes, offsets: dict[int, int]
    ) -> ChunkIndex:
        """Return the chunk index record for the summary; start is the chunk's file position."""
        start_ns, end_ns = self.span()
        return ChunkIndex(
            chunk_length=9 + 40 + len(compression) + stored,
            chunk_start_offset=start,
            compression=compression,
            compressed_size=stored,
            message_end_time=end_ns,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=start_ns,
            uncompressed_size=self.size,
        )


class Chunks(ABC):
    """A writer that groups messages into chunks and writes these to a file."""

    def __init__(self, file: VectoredFile) -> None:
        self._file = file
        self._entries: list[ChunkIndex] = []
        self._contents = _Contents()

    @abstractmethod
    def add(self, channel_id: int, sequence: int, stamp_ns: int, parts: Parts) -> None:
        """Append a message; the chunk ends when it has its size."""

    def add_records(self, records: bytes) -> None:
        """Append records outside of any chunk, after the messages added so far."""
        self._flush()
        self._file.write([records])

    def finish(self) -> list[ChunkIndex]:
        """Write the rest, and return the index records of all chunks."""
        self._flush()
        self.cancel()
        return self._entries

    @abstractmethod
    def cancel(self) -> None:
        """Drop unwritten data and stop all threads."""

    @abstractmethod
    def _flush(self) -> None:
        """End the chunk, and write all that is not written yet."""


class StreamedChunks(Chunks):
    """Uncompressed chunks: payloads are written at once, the chunk's head when it is known.

    Checksumming and writing a payload while it is in the processor's cache halves the cost, which
    is more than a second thread would save.
    """

    def __init__(self, file: VectoredFile) -> None:
        super().__init__(file)
        self._start = -1
        self._tail = bytearray()

    def add(self, channel_id: int, sequence: int, stamp_ns: int, parts: Parts) -> None:
        """Append a message; the chunk ends when it has its size."""
        contents = self._contents
        tail = self._tail
        tail += contents.message_head(channel_id, sequence, stamp_ns, parts)
        for part in parts:
            if len(part) < _COPIED_BELOW:
                tail += part
            else:
                self._write(tail, part)
                tail = self._tail
        if len(tail) >= _WRITTEN_FROM:
            self._write(tail)
        if contents.size >= TARGET_SIZE:
            self._flush()

    def cancel(self) -> None:
        """Drop unwritten data."""
        self._tail = bytearray()

    def _write(self, *buffers: bytes | bytearray | memoryview) -> None:
        contents = self._contents
        for buffer in buffers:
            contents.crc = crc32(buffer, contents.crc)
        if self._start < 0:
            self._start = self._file.position
            # Alone: pages written along with large buffers would be read again to be changed.
            self._file.write([bytes(_CHUNK_HEAD.size + 12)])
        self._file.write(buffers)
        self._tail = bytearray()

    def _flush(self) -> None:
        contents = self._contents
        if not contents.size:
            return
        if self._tail:
            self._write(self._tail)
        start, self._start = self._start, -1
        self._contents = _Contents()
        self._file.write_at(start, contents.head(b'', contents.size))
        indexes, offsets = contents.indexes(self._file.position)
        self._file.write([indexes])
        self._entries.append(contents.entry(start, '', contents.size, indexes, offsets))


class CompressedChunks(Chunks):
    """Compressed chunks: compressed on all cores, written in order."""

    def __init__(self, file: VectoredFile, options: BagOptions, threads: int) -> None:
        super().__init__(file)
        self._name = options.compression
        self._compress = compressor(options.compression, options.compression_level)
        self._pool: OrderedPool[tuple[_Contents, bytes]] = OrderedPool(threads, POOL_AHEAD)
        self._buffers: list[bytes | memoryview] = []

    def add(self, channel_id: int, sequence: int, stamp_ns: int, parts: Parts) -> None:
        """Append a message; the chunk ends when it has its size."""
        contents = self._contents
        self._buffers.append(contents.message_head(channel_id, sequence, stamp_ns, parts))
        self._buffers += parts
        if contents.size >= TARGET_SIZE:
            self._end_chunk()

    def cancel(self) -> None:
        """Drop unwritten data and wait for the threads to end."""
        self._pool.close()

    def _end_chunk(self) -> None:
        contents, self._contents = self._contents, _Contents()
        buffers, self._buffers = self._buffers, []
        if contents.size:
            for packed in self._pool.put(partial(_pack, contents, buffers, self._compress)):
                self._write(*packed)

    def _flush(self) -> None:
        self._end_chunk()
        for packed in self._pool.drain():
            self._write(*packed)

    def _write(self, contents: _Contents, data: bytes) -> None:
        start = self._file.position
        head = contents.head(self._name.encode(), len(data))
        indexes, offsets = contents.indexes(start + len(head) + len(data))
        self._file.write([head, data, indexes])
        self._entries.append(contents.entry(start, self._name, len(data), indexes, offsets))


def _pack(
    contents: _Contents, buffers: list[bytes | memoryview], compress: Callable[[bytes], bytes]
) -> tuple[_Contents, bytes]:
    data = b''.join(buffers)
    if len(data) != contents.size:
        raise ValueError("a message part is no flat buffer of bytes (memoryview format 'B')")
    contents.crc = crc32(data)
    return contents, compress(data)
