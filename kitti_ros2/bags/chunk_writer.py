# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The chunks of a file being written: streamed, or compressed on all cores.

The containers with chunks, MCAP and ROS 1, differ in their records: see ChunkContents.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import TYPE_CHECKING, Generic, TypeAlias, TypeVar

from ..files.threads import OrderedPool
from .file_writer import POOL_AHEAD

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..files.local_files import UnbufferedFile
    from .file_writer import Parts

Buffer: TypeAlias = 'bytes | bytearray | memoryview'
Entry = TypeVar('Entry')

# Below this size a copy costs less than one more buffer to pass on.
_COPIED_BELOW = 4096
_WRITTEN_FROM = 64 * 2**10


class ChunkContents(ABC, Generic[Entry]):
    """Size and index of a chunk while it grows, and the records of its container.

    Attributes:
        size: Bytes of the uncompressed records.
        index: Stamp and offset of each message, in one flat list by channel id.
    """

    __slots__ = ('index', 'size')

    def __init__(self) -> None:
        self.size = 0
        self.index: dict[int, list[int]] = {}

    def span(self) -> tuple[int, int]:
        """Return the least and greatest stamp, (0, 0) without messages."""
        stamps = [entries[::2] for entries in self.index.values()]
        return min(map(min, stamps), default=0), max(map(max, stamps), default=0)

    @abstractmethod
    def is_full(self) -> bool:
        """Return whether the chunk has its size."""

    @abstractmethod
    def message_head(self, channel_id: int, sequence: int, stamp_ns: int, size: int) -> bytes:
        """Return the bytes that precede a message of a size."""

    def checksum(self, data: Buffer) -> None:
        """Enter bytes of the records, in order."""

    @abstractmethod
    def open_head(self) -> bytes:
        """Return what stands for the head of an uncompressed chunk while the chunk grows."""

    @abstractmethod
    def head(self, compression: str, stored: int) -> bytes:
        """Return the chunk up to its records, which are stored in so many bytes."""

    @abstractmethod
    def finish(
        self, compression: str, start: int, position: int, stored: int
    ) -> tuple[bytes, Entry]:
        """Return the indexes that follow the chunk, and its entry in the index of the file.

        Args:
            compression: Its name; empty for none.
            start: Position of the chunk.
            position: Position of the indexes.
            stored: Bytes of the records in the file.
        """


class Chunks(ABC, Generic[Entry]):
    """A writer that groups messages into chunks and writes these to a file.

    Args:
        file: The file.
        contents: Makes the contents of each chunk.
    """

    def __init__(self, file: UnbufferedFile, contents: Callable[[], ChunkContents[Entry]]) -> None:
        self._file = file
        self._new = contents
        self._contents = contents()
        self._entries: list[Entry] = []

    def add(self, channel_id: int, sequence: int, stamp_ns: int, parts: Parts) -> None:
        """Append a message; the chunk ends when it has its size."""
        contents = self._contents
        size = 0
        for part in parts:
            size += len(part)
        head = contents.message_head(channel_id, sequence, stamp_ns, size)
        entries = contents.index.get(channel_id)
        if entries is None:
            entries = contents.index[channel_id] = []
        entries += (stamp_ns, contents.size)
        contents.size += len(head) + size
        self._append(head, parts)
        if contents.is_full():
            self._end_chunk()

    def add_inside(self, record: bytes) -> None:
        """Append a record that is no message to the chunk."""
        self._contents.size += len(record)
        self._append(record, ())

    def add_outside(self, records: bytes) -> None:
        """Append records outside of any chunk, after the messages added so far."""
        self._flush()
        self._file.write([records])

    def finish(self) -> list[Entry]:
        """Write the rest, and return the entries of all chunks in the index of the file."""
        self._flush()
        self.cancel()
        return self._entries

    @abstractmethod
    def cancel(self) -> None:
        """Drop unwritten data and stop all threads."""

    @abstractmethod
    def _append(self, head: bytes, parts: Parts) -> None:
        """Append bytes to the chunk."""

    @abstractmethod
    def _end_chunk(self) -> None:
        """End the chunk, unless it is empty."""

    def _flush(self) -> None:
        """End the chunk, and write all that is not written yet."""
        self._end_chunk()


class StreamedChunks(Chunks[Entry]):
    """Uncompressed chunks: payloads are written at once, the chunk's head when it is known.

    Checksumming and writing a payload while it is in the processor's cache halves the cost, which
    is more than a second thread would save.
    """

    def __init__(self, file: UnbufferedFile, contents: Callable[[], ChunkContents[Entry]]) -> None:
        super().__init__(file, contents)
        self._start = -1
        self._tail = bytearray()

    def cancel(self) -> None:
        """Drop unwritten data."""
        self._tail = bytearray()

    def _append(self, head: bytes, parts: Parts) -> None:
        tail = self._tail
        tail += head
        for part in parts:
            if len(part) < _COPIED_BELOW:
                tail += part
            else:
                self._write(tail, part)
                tail = self._tail
        if len(tail) >= _WRITTEN_FROM:
            self._write(tail)

    def _write(self, *buffers: Buffer) -> None:
        contents = self._contents
        for buffer in buffers:
            contents.checksum(buffer)
        if self._start < 0:
            self._start = self._file.position
            # Alone: pages written along with large buffers would be read again to be changed.
            self._file.write([contents.open_head()])
        self._file.write(buffers)
        self._tail = bytearray()

    def _end_chunk(self) -> None:
        contents = self._contents
        if not contents.size:
            return
        if self._tail:
            self._write(self._tail)
        start, self._start = self._start, -1
        self._contents = self._new()
        self._file.write_at(start, contents.head('', contents.size))
        indexes, entry = contents.finish('', start, self._file.position, contents.size)
        self._file.write([indexes])
        self._entries.append(entry)


class CompressedChunks(Chunks[Entry]):
    """Compressed chunks: compressed on all cores, written in order.

    Args:
        file: The file.
        contents: Makes the contents of each chunk.
        name: The compression.
        compress: Compresses the records of a chunk; it may be called in several threads.
        threads: Number of these.
    """

    def __init__(
        self,
        file: UnbufferedFile,
        contents: Callable[[], ChunkContents[Entry]],
        name: str,
        compress: Callable[[bytes], bytes],
        threads: int,
    ) -> None:
        super().__init__(file, contents)
        self._name = name
        self._compress = compress
        self._pool: OrderedPool[tuple[ChunkContents[Entry], bytes]] = OrderedPool(
            threads, POOL_AHEAD
        )
        self._buffers: list[Buffer] = []

    def cancel(self) -> None:
        """Drop unwritten data and wait for the threads to end."""
        self._pool.close()

    def _append(self, head: bytes, parts: Parts) -> None:
        self._buffers.append(head)
        self._buffers += parts

    def _end_chunk(self) -> None:
        contents, self._contents = self._contents, self._new()
        buffers, self._buffers = self._buffers, []
        if contents.size:
            for packed in self._pool.put(partial(_pack, contents, buffers, self._compress)):
                self._write(*packed)

    def _flush(self) -> None:
        self._end_chunk()
        for packed in self._pool.drain():
            self._write(*packed)

    def _write(self, contents: ChunkContents[Entry], data: bytes) -> None:
        start = self._file.position
        head = contents.head(self._name, len(data))
        position = start + len(head) + len(data)
        indexes, entry = contents.finish(self._name, start, position, len(data))
        self._file.write([head, data, indexes])
        self._entries.append(entry)


def _pack(
    contents: ChunkContents[Entry], buffers: Sequence[Buffer], compress: Callable[[bytes], bytes]
) -> tuple[ChunkContents[Entry], bytes]:
    data = b''.join(buffers)
    if len(data) != contents.size:
        raise ValueError("a message part is no flat buffer of bytes (memoryview format 'B')")
    contents.checksum(data)
    return contents, compress(data)
