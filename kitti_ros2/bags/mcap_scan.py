# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The scan of an MCAP file, and the descriptions of its channels."""

from __future__ import annotations

import struct
from array import array
from io import BytesIO
from sys import intern
from typing import TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from .chunk_scan import ChunkScan
from .limits import LimitError
from .mcap_records import MCAP, MESSAGE_BODY
from .offered_qos import offered_qos
from .pieces import StoredChannel
from .spelling import ros2_spelling

if TYPE_CHECKING:
    from .chunk_scan import Run
    from .findings import Findings
    from .limits import DescriptionLimits
    from .pieces import Buffer, FileBytes

# Raised by the library on damaged records.
RECORD_ERRORS = (McapError, struct.error, UnicodeDecodeError, EOFError, LookupError, ValueError)
_NESTED = 'a chunk inside a chunk, where MCAP has none, is not read'


class _McapChannel(NamedTuple):
    """What a Channel record says; the library's records take three times the memory."""

    topic: str
    schema_id: int
    encoding: str
    profiles: str

    def contradicts(self, other: _McapChannel) -> bool:
        """Whether another record describes another channel; a copy may lack the QoS profiles."""
        return self[:3] != other[:3]


class Descriptions:
    """The schemas and channels of a file.

    The first of an id is used: chunks have a checksum, the copies in a damaged summary have none.

    Args:
        room: How many there may be.
    """

    def __init__(self, room: DescriptionLimits) -> None:
        self._room = room
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, _McapChannel] = {}

    def enter(self, opcode: int, body: Buffer) -> str:
        """Enter a schema or a channel; ignore other records.

        Returns:
            What the record contradicts, such as another of its id; empty for nothing.

        Raises:
            LimitError: There are too many.
            RECORD_ERRORS: The record is damaged.
        """
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            if schema.id not in self._schemas:
                self._room.add(len(body))
            first = self._schemas.setdefault(schema.id, schema)
            return (
                '' if first == schema else _two_ways('schema', schema.id, first.name, schema.name)
            )
        if opcode == Opcode.CHANNEL:
            channel_id, channel = _parse_channel(body)
            if channel_id not in self._channels:
                self._room.add(len(body))
            known = self._channels.setdefault(channel_id, channel)
            if known.contradicts(channel):
                return _two_ways('channel', channel_id, self._name(known), self._name(channel))
        return _NESTED if opcode == Opcode.CHUNK else ''

    def _name(self, channel: _McapChannel) -> str:
        schema = self._schemas.get(channel.schema_id)
        return f'{channel.topic} ({schema.name if schema else "no type"})'

    def channels(self) -> dict[int, StoredChannel]:
        """Return the channels by id."""
        texts = {key: each.data.decode(errors='replace') for key, each in self._schemas.items()}
        return {
            key: self._source_channel(channel, texts.get(channel.schema_id, ''))
            for key, channel in self._channels.items()
        }

    def _source_channel(self, channel: _McapChannel, definition: str) -> StoredChannel:
        schema = self._schemas.get(channel.schema_id)
        name = schema.name if schema else ''
        cdr = channel.encoding == 'cdr' and '/' in name
        return StoredChannel(
            channel.topic,
            ros2_spelling(name) if cdr else name,
            channel.encoding,
            definition,
            schema.encoding if schema else '',
            schema=schema.data if schema and schema.encoding == 'protobuf' else b'',
            **offered_qos(channel.profiles),
        )


def _parse_channel(body: Buffer) -> tuple[int, _McapChannel]:
    """Parse a Channel record and its id.

    Raises:
        RECORD_ERRORS: The record is damaged.
    """
    record = Channel.read(ReadDataStream(BytesIO(body)))
    profiles = record.metadata.get('offered_qos_profiles', '')
    encoding = intern(record.message_encoding)
    return record.id, _McapChannel(record.topic, record.schema_id, encoding, profiles)


def _two_ways(noun: str, number: int, first: str, second: str) -> str:
    """Return the text of a loss: what of a number is described again as something else."""
    return f'{noun} {number} is described in two ways, {first} and {second}; the first counts'


class McapScan(ChunkScan[int]):
    """A scan of an MCAP file.

    Args:
        file: The file to read.
        findings: Damage is entered there.

    Attributes:
        described: The schemas and channels so far.
    """

    noun = 'channel'
    descriptions = (Opcode.SCHEMA, Opcode.CHANNEL)
    footer = Opcode.FOOTER
    data_end = Opcode.DATA_END

    def __init__(self, file: FileBytes, findings: Findings) -> None:
        super().__init__(file, findings, MCAP)
        self.described = Descriptions(file.limits.descriptions())

    def _enter_record(self, head: int, body: Buffer, run: Run) -> None:
        if head == Opcode.MESSAGE:
            channel_id, _, stamp_ns, _ = MESSAGE_BODY.unpack_from(body)
            self._stamps.setdefault(channel_id, array('Q')).append(stamp_ns)
            run.add(channel_id, stamp_ns)
            return
        try:
            clash = self.described.enter(head, body)
        except LimitError as error:
            self._refused = error
        except RECORD_ERRORS as error:
            kind = Opcode(head).name.lower()
            self._findings.lose(f'{self._file.name}: a {kind} record is damaged ({error})')
        else:
            if clash:
                self._findings.lose(f'{self._file.name}: {clash}', None if clash is _NESTED else 0)

    def _channels(self) -> dict[int, StoredChannel]:
        return self.described.channels()
