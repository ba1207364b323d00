# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan of an MCAP file from its start, record by record, up to its end.

It needs neither summary nor footer, so it reads files that a recorder left truncated. Damaged
bytes are skipped and entered as losses.
"""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass, field
from io import BytesIO
from typing import TYPE_CHECKING

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from .decompressors import UNCOMPRESSED
from .mcap_records import (
    MCAP,
    MESSAGE_BODY,
    RECORD_HEAD,
    DamagedHeadError,
    parse_chunk_head,
    split_records,
    unpack_chunk,
)
from .mcap_summary import MAGIC
from .pieces import HeldBytes, Run
from .record_walk import walk

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .findings import Findings
    from .pieces import Buffer, FileBytes, Piece
    from .record_walk import Record

_OF_A_RUN = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}

# Raised by the library on damaged records.
RECORD_ERRORS = (McapError, struct.error, UnicodeDecodeError, EOFError, LookupError, ValueError)


@dataclass
class McapContents:
    """The contents of a file.

    Attributes:
        schemas, channels: By id.
        pieces: Chunks, and runs of records outside of chunks.
        compressions: Names of the compressions found.
        stamps: Nanoseconds by channel id; None if they are in the message indexes only.
        index_lengths: Bytes of the message indexes behind each piece.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    compressions: set[str] = field(default_factory=set)
    stamps: dict[int, array[int]] | None = None
    index_lengths: list[int] = field(default_factory=list)


class McapScan:
    """A scan of a file.

    Args:
        file: The file to read.
        findings: Damage is entered there.
    """

    def __init__(self, file: FileBytes, findings: Findings) -> None:
        self.contents = McapContents()
        self._stamps: dict[int, array[int]] = {}
        self._file = file
        self._findings = findings
        self._run = Run(0)
        self._cut_at: int | None = None
        self._read = 'what comes before'

    def run(self) -> McapContents:
        """Scan the file once.

        Raises:
            OSError: The file cannot be read.
        """
        file = self._file
        for record in walk(MCAP, file, len(MAGIC), file.size, self._lose_bytes):
            if record.opcode == Opcode.FOOTER and record.end <= file.size:
                break
            self._enter(record)
        else:
            place = '' if self._cut_at is None else f', in the record at {self._cut_at}'
            text = f'{file.name}: cut off at byte {file.size}{place}; {self._read} was read'
            self._findings.lose(text, 0 if self._read == 'every message' else None)
        self._end_run()
        for channel_id in self._stamps.keys() - self.contents.channels.keys():
            count = len(self._stamps.pop(channel_id))
            text = f'{file.name}: channel {channel_id} is not described; its messages are left out'
            self._findings.lose(text, count)
        self.contents.stamps = self._stamps
        return self.contents

    def _lose_bytes(self, start: int, end: int) -> None:
        self._findings.lose(f'{self._file.name}: bytes {start} to {end} are damaged')

    def _enter(self, record: Record) -> None:
        if record.end > self._file.size:
            self._cut_at = record.position if self._cut_at is None else self._cut_at
        if record.opcode == Opcode.CHUNK:
            self._end_run()
            self._enter_chunk(record)
        elif record.end > self._file.size:
            return
        elif record.opcode in _OF_A_RUN:
            body = RECORD_HEAD.size + MESSAGE_BODY.size
            whole = record.opcode != Opcode.MESSAGE
            data = self._file.read(record.position, record.end - record.position if whole else body)
            if not self._run.takes(record):
                self._end_run()
                self._run = Run(record.position)
            self._run.end = record.end
            self._enter_record(record.opcode, memoryview(data)[RECORD_HEAD.size :], self._run)
        elif record.opcode == Opcode.DATA_END:
            self._read = 'every message'

    def _enter_chunk(self, record: Record) -> None:
        data = self._file.read(record.position, record.end - record.position)
        try:
            compression = parse_chunk_head(data).compression
        except DamagedHeadError:
            return  # truncated before its records
        self.contents.compressions.add(compression)
        if len(data) < record.end - record.position and compression in UNCOMPRESSED:
            return  # its records follow, one by one
        run = Run(record.position, record.position + len(data))
        for opcode, body in piece_records(self._file, record.position, data, self._findings):
            self._enter_record(opcode, body, run)
        run.end_in(self.contents.pieces)

    def _enter_record(self, opcode: int, body: Buffer, run: Run) -> None:
        if opcode == Opcode.MESSAGE:
            channel_id, _, stamp_ns, _ = MESSAGE_BODY.unpack_from(body)
            self._stamps.setdefault(channel_id, array('Q')).append(stamp_ns)
            run.add(channel_id, stamp_ns)
            return
        try:
            enter_description(self.contents, opcode, body)
        except RECORD_ERRORS as error:
            kind = Opcode(opcode).name.lower()
            self._findings.lose(f'{self._file.name}: a {kind} record is damaged ({error})')

    def _end_run(self) -> None:
        self._run.end_in(self.contents.pieces)
        self._run = Run(0)


def enter_description(contents: McapContents, opcode: int, body: Buffer) -> None:
    """Enter a schema or a channel; ignore other records.

    The first of an id is used: chunks have a checksum, the copies in a damaged summary have none.

    Raises:
        RECORD_ERRORS: The record is damaged.
    """
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(ReadDataStream(BytesIO(body)))
        contents.schemas.setdefault(schema.id, schema)
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(ReadDataStream(BytesIO(body)))
        contents.channels.setdefault(channel.id, channel)


def piece_records(
    file: FileBytes, position: int, data: Buffer, findings: Findings, cost: int | None = None
) -> Iterator[tuple[int, memoryview]]:
    """Yield the records of a piece with their opcodes; skip damaged bytes.

    Args:
        file: The file of the piece.
        position: Of its first byte.
        data: A chunk, or records outside of chunks.
        findings: Damage is entered there.
        cost: Number of messages lost if nothing of it can be read.
    """
    place = f'{file.name}: the chunk at byte {position} is damaged'
    view, end, whole = memoryview(data), 0, True
    try:
        if view and view[0] == Opcode.CHUNK:
            records, whole = unpack_chunk(view)
            view = memoryview(records)
        for record in split_records(view):
            yield record.opcode, view[record.position + RECORD_HEAD.size : record.end]
            end = record.end
    except DamagedHeadError:
        pass  # if it is not compressed, its records can be found below
    except ValueError as error:
        findings.lose(f'{place} ({error})', cost)
        return

    def lose(start: int, stop: int) -> None:
        findings.lose(f'{place} (bytes {start} to {stop} of it)')

    if whole:
        for record in walk(MCAP, HeldBytes(view), end, len(view), lose):
            if record.end <= len(view):
                yield record.opcode, view[record.position + RECORD_HEAD.size : record.end]
            else:
                lose(record.position, len(view))
