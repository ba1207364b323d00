# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One MCAP file as rosbag2 writes it: profile ros2, ros2msg schemas, chunks, indexes, summary."""

from __future__ import annotations

import struct
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
from .chunk_writer import ChunkContents, Chunks, CompressedChunks, StreamedChunks
from .file_writer import compressor, qos_text

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence
    from pathlib import Path

    from ..model.bag_formats import Channel
    from .chunk_writer import Buffer
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

_MESSAGE_HEAD = struct.Struct('<BQHIQQ')
_CHUNK_HEAD = struct.Struct('<BQQQQI')
_INDEX_HEAD = struct.Struct('<BQHI')


class _McapChunk(ChunkContents[ChunkIndex]):
    """The contents of a chunk.

    Attributes:
        crc: CRC-32 of the records.
    """

    __slots__ = ('crc',)

    def __init__(self) -> None:
        super().__init__()
        self.crc = 0

    def is_full(self) -> bool:
        """Return whether the chunk has its size."""
        return self.size >= TARGET_SIZE

    def message_head(self, channel_id: int, sequence: int, stamp_ns: int, size: int) -> bytes:
        """Return the bytes that precede a message of a size."""
        length = _MESSAGE_HEAD.size - 9 + size
        return _MESSAGE_HEAD.pack(5, length, channel_id, sequence, stamp_ns, stamp_ns)

    def checksum(self, data: Buffer) -> None:
        """Continue the CRC."""
        self.crc = crc32(data, self.crc)

    def open_head(self) -> bytes:
        """Return bytes of the length of an uncompressed chunk's head."""
        return bytes(_CHUNK_HEAD.size + 12)

    def head(self, compression: str, stored: int) -> bytes:
        """Return the chunk record up to the records in it."""
        name = compression.encode()
        length = 40 + len(name) + stored
        head = _CHUNK_HEAD.pack(Opcode.CHUNK, length, *self.span(), self.size, self.crc)
        return head + struct.pack(f'<I{len(name)}sQ', len(name), name, stored)

    def finish(
        self, compression: str, start: int, position: int, stored: int
    ) -> tuple[bytes, ChunkIndex]:
        """Return the message index records, and the chunk index record for the summary."""
        indexes = bytearray()
        offsets = {}
        for channel_id, entries in self.index.items():
            offsets[channel_id] = position + len(indexes)
            size = 8 * len(entries)
            indexes += _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel_id, size)
            indexes += struct.pack(f'<{len(entries)}Q', *entries)
        start_ns, end_ns = self.span()
        entry = ChunkIndex(
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
        return bytes(indexes), entry


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
        name = context.options.compression
        self._chunks: Chunks[ChunkIndex] = StreamedChunks(self._file, _McapChunk)
        if name != 'none':
            compress = compressor(name, context.options.compression_level)
            self._chunks = CompressedChunks(self._file, _McapChunk, name, compress, context.threads)
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
        self._chunks.add_outside(encode([*records, self._record(channel_id, channel)]))

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
