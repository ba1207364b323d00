# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One MCAP file as rosbag2 writes it: profile ros2, ros2msg schemas, chunks, indexes, summary."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from functools import partial
from itertools import chain, starmap
from typing import TYPE_CHECKING

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import (
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ..files.local_files import UnbufferedFile, crc32
from ..files.threads import OrderedPool
from .file_writer import POOL_AHEAD, compressor, qos_text

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.bag_formats import Channel
    from ..options.outputs import BagOptions
    from .file_writer import Parts, WriterContext


# The chunks of an MCAP file being written: messages, their CRC and their indexes.
#
# Record layouts (https://mcap.dev/spec), little endian; every record begins with opcode (uint8) and
# length (uint64) of what follows:
#
# - Message: channel (uint16), sequence (uint32), log time, publish time (uint64, ns), data.
# - Chunk: start time, end time, uncompressed size (uint64), crc of the uncompressed records
#   (uint32), compression (uint32 length, text), size of the records (uint64), records.
# - Message Index: channel (uint16), size in bytes (uint32), then log time and offset in the
#   uncompressed chunk (uint64) of each message.

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

    def __init__(self, file: UnbufferedFile) -> None:
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

    def __init__(self, file: UnbufferedFile) -> None:
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

    def __init__(self, file: UnbufferedFile, options: BagOptions, threads: int) -> None:
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


# The end of an MCAP file: summary section, summary offsets and footer (https://mcap.dev/spec).

MAGIC = b'\x89MCAP0\r\n'


def encode(records: Iterable[McapRecord]) -> bytes:
    """Encode records as bytes of a file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def metadata_record(name: str, metadata: Mapping[str, bytes]) -> list[bytes]:
    """Return a Metadata record in parts: the text of many topics is tens of megabytes.

    Args:
        name: Name of the record.
        metadata: Texts in UTF-8 by key.
    """
    entries = [_prefixed(text) for key, value in metadata.items() for text in (key.encode(), value)]
    size = sum(map(len, chain.from_iterable(entries)))
    body = [*_prefixed(name.encode()), size.to_bytes(4, 'little'), *chain.from_iterable(entries)]
    length = sum(map(len, body))
    return [bytes([Opcode.METADATA]), length.to_bytes(8, 'little'), *body]


def summary_section(
    position: int,
    schemas: Collection[Schema],
    channels: Iterable[ChannelRecord],
    counts: Mapping[int, int],
    chunks: Sequence[ChunkIndex],
    metadata: Sequence[MetadataIndex],
) -> list[bytes]:
    """Return everything that follows the data section, including the closing magic.

    Args:
        position: File position of the summary.
        schemas: Schema records.
        channels: Records of the channels that are counted, which may be made one by one.
        counts: Messages by channel id.
        chunks: Chunk index records.
        metadata: Metadata index records.

    Returns:
        Buffers to be concatenated.
    """
    statistics = Statistics(
        attachment_count=0,
        channel_count=len(counts),
        channel_message_counts=dict(counts),
        chunk_count=len(chunks),
        message_count=sum(counts.values()),
        message_end_time=max((chunk.message_end_time for chunk in chunks), default=0),
        message_start_time=min((chunk.message_start_time for chunk in chunks), default=0),
        metadata_count=len(metadata),
        schema_count=len(schemas),
    )
    groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
        (Opcode.SCHEMA, schemas),
        (Opcode.CHANNEL, channels),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, chunks),
        (Opcode.METADATA_INDEX, metadata),
    ]
    encoded = [(opcode, encode(group)) for opcode, group in groups]
    return _assemble(position, [(opcode, data) for opcode, data in encoded if data])


def _prefixed(data: bytes) -> list[bytes]:
    return [len(data).to_bytes(4, 'little'), data]


def _assemble(position: int, groups: Sequence[tuple[Opcode, bytes]]) -> list[bytes]:
    offsets = []
    start = position
    for opcode, data in groups:
        offsets.append(
            SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(data))
        )
        start += len(data)
    footer = encode([Footer(summary_start=position, summary_offset_start=start, summary_crc=0)])
    # The CRC covers the summary and the footer up to the CRC itself.
    body = [*(data for _, data in groups), encode(offsets), footer[:-4]]
    crc = 0
    for data in body:
        crc = crc32(data, crc)
    return [*body, crc.to_bytes(4, 'little'), MAGIC]


class McapFileWriter:
    """The writer of one MCAP file."""

    def __init__(self, path: Path, context: WriterContext) -> None:
        self._typestore = context.typestore
        self._schemas: dict[str, Schema] = {}
        self._hashes: dict[str, str] = {}
        self._channels: list[Channel] = []
        self._sequences: list[int] = []
        self._metadata: list[MetadataIndex] = []
        self._file = UnbufferedFile(path)
        options = context.options
        self._chunks = (
            StreamedChunks(self._file)
            if options.compression == 'none'
            else CompressedChunks(self._file, options, context.threads)
        )
        try:
            self._file.write([MAGIC, encode([Header('ros2', 'kitti_ros2')])])
            if context.source_metadata:
                source = context.source_metadata
                encoded = {key: value.encode() for key, value in source.items()}
                self._write_metadata('kitti_ros2', encoded)
        except BaseException:
            self.abort()
            raise

    def add_channel(self, channel_id: int, channel: Channel) -> None:
        """Write the channel's record, preceded by its schema's if the type is new."""
        records: list[McapRecord] = []
        schema = self._schemas.get(channel.msgtype)
        if schema is None:
            text = self._typestore.generate_msgdef(channel.msgtype, ros_version=2)[0]
            schema = Schema(
                id=len(self._schemas) + 1,
                data=text.encode(),
                encoding='ros2msg',
                name=channel.msgtype,
            )
            self._hashes[channel.msgtype] = self._typestore.hash_rihs01(channel.msgtype)
            self._schemas[channel.msgtype] = schema
            records.append(schema)
        self._channels.append(channel)
        self._sequences.append(0)
        self._chunks.add_records(encode([*records, self._record(channel_id, channel)]))

    def _record(self, channel_id: int, channel: Channel) -> ChannelRecord:
        return ChannelRecord(
            id=channel_id + 1,
            topic=channel.topic,
            message_encoding='cdr',
            metadata={
                'offered_qos_profiles': qos_text(channel),
                'topic_type_hash': self._hashes[channel.msgtype],
            },
            schema_id=self._schemas[channel.msgtype].id,
        )

    def write(self, channel_id: int, stamp_ns: int, parts: Parts) -> None:
        """Append one message."""
        sequence = self._sequences[channel_id]
        self._sequences[channel_id] = sequence + 1
        self._chunks.add(channel_id + 1, sequence, stamp_ns, parts)

    def close(self, information: bytes) -> None:
        """Write the last chunk, the bag's metadata and the summary."""
        indexes = self._chunks.finish()
        self._write_metadata('rosbag2', {'serialized_metadata': information})
        self._file.write([encode([DataEnd(data_section_crc=0)])])
        counts = {i + 1: count for i, count in enumerate(self._sequences)}
        self._file.write(
            summary_section(
                self._file.position,
                self._schemas.values(),
                starmap(self._record, enumerate(self._channels)),
                counts,
                indexes,
                self._metadata,
            )
        )
        self._file.close()

    def abort(self) -> None:
        """Stop all threads and close the file."""
        self._chunks.cancel()
        self._file.close()

    def _write_metadata(self, name: str, metadata: dict[str, bytes]) -> None:
        parts = metadata_record(name, metadata)
        length = sum(map(len, parts))
        self._metadata.append(MetadataIndex(offset=self._file.position, length=length, name=name))
        self._file.write(parts)
