# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One MCAP file as rosbag2 writes it: profile ros2, ros2msg schemas, chunks, indexes, summary."""

from __future__ import annotations

from itertools import starmap
from typing import TYPE_CHECKING

from mcap.records import Channel as ChannelRecord
from mcap.records import DataEnd, Header, McapRecord, MetadataIndex, Schema

from ..files.vectored import VectoredFile
from .mcap_chunk import CompressedChunks, StreamedChunks
from .mcap_summary import MAGIC, encode, metadata_record, summary_section
from .metadata import qos_text

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.channels import Channel
    from .contract import Parts, SegmentContext


class McapSegment:
    """The writer of one MCAP file."""

    def __init__(self, path: Path, context: SegmentContext) -> None:
        self._typestore = context.typestore
        self._schemas: dict[str, Schema] = {}
        self._hashes: dict[str, str] = {}
        self._channels: list[Channel] = []
        self._sequences: list[int] = []
        self._metadata: list[MetadataIndex] = []
        self._file = VectoredFile(path)
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
