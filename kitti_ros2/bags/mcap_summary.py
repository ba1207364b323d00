# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The end of an MCAP file: summary section, summary offsets and footer (https://mcap.dev/spec)."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Footer, Statistics, SummaryOffset

from ..files.checksums import crc32

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from mcap.records import Channel as ChannelRecord
    from mcap.records import ChunkIndex, McapRecord, MetadataIndex, Schema

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
        name: Of the record.
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
