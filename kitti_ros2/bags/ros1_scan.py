# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan of a ROS 1 .bag file from its start, record by record, up to its end.

It needs no index, so it reads files that a recorder left truncated (.bag.active). Damaged bytes are
skipped and entered as losses.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosbags.typesys.msg import normalize_msgtype

from .offered_qos import latched_qos
from .pieces import HeldBytes, Run, StoredChannel
from .record_walk import walk
from .ros1_records import (
    CHUNK,
    CONNECTION,
    MAGIC,
    MESSAGE,
    ROS1,
    opcode_of,
    parse_fields,
    parse_message,
    split_record,
    split_records,
    unpack_chunk,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from .findings import Findings
    from .pieces import Buffer, FileBytes, Piece
    from .record_walk import Record

_HEAD_READ = 256


@dataclass(frozen=True)
class Ros1Channel(StoredChannel):
    """A connection.

    Attributes:
        md5sum: Of the definition.
        callerid: The publisher's node.
    """

    md5sum: str = ''
    callerid: str | None = None


@dataclass
class Ros1Contents:
    """The contents of a file.

    Attributes:
        channels: Connections by id.
        pieces: Chunks, and runs of records outside of chunks.
        compressions: Names of the compressions found; of an indexed file they are in the chunks.
        stamps: Nanoseconds by connection id; None if they are in the chunks' indexes only.
    """

    channels: dict[int, Ros1Channel] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    compressions: set[str] = field(default_factory=set)
    stamps: dict[int, array[int]] | None = None


class Ros1Scan:
    """A scan of a file.

    Args:
        file: The file to read.
        findings: Damage is entered there.
    """

    def __init__(self, file: FileBytes, findings: Findings) -> None:
        self.contents = Ros1Contents()
        self._stamps: dict[int, array[int]] = {}
        self._file = file
        self._findings = findings
        self._run = Run(0)
        self._cut_at: int | None = None

    def run(self) -> Ros1Contents:
        """Scan the file once.

        Raises:
            OSError: The file cannot be read.
        """
        file = self._file
        for record in walk(ROS1, file, len(MAGIC), file.size, self._lose_bytes):
            if record.end > file.size and self._cut_at is None:
                self._cut_at = record.position
            self._enter(record)
        self._end_run()
        if self._cut_at is not None:
            place = f'{file.name}: cut off at byte {file.size}, in the record at {self._cut_at}'
            self._findings.lose(f'{place}; what comes before was read')
        for channel_id in self._stamps.keys() - self.contents.channels.keys():
            count = len(self._stamps.pop(channel_id))
            text = f'connection {channel_id} is not described; its messages are left out'
            self._findings.lose(f'{file.name}: {text}', count)
        self.contents.stamps = self._stamps
        return self.contents

    def _lose_bytes(self, start: int, end: int) -> None:
        self._findings.lose(f'{self._file.name}: bytes {start} to {end} are damaged')

    def _enter(self, record: Record) -> None:
        whole = record.end <= self._file.size
        if record.opcode == CHUNK:
            self._end_run()
            self._enter_chunk(record)
        elif whole and record.opcode in {MESSAGE, CONNECTION}:
            size = record.end - record.position
            data = self._file.read(
                record.position, size if record.opcode == CONNECTION else _HEAD_READ
            )
            if not self._run.takes(record):
                self._end_run()
                self._run = Run(record.position)
            self._run.end = record.end
            fields, start, end = split_record(data, 0)
            self._enter_record(fields, data[start:end], self._run)

    def _enter_chunk(self, record: Record) -> None:
        data = self._file.read(record.position, record.end - record.position)
        compression = split_record(data, 0)[0][b'compression'].decode('ascii', 'replace')
        self.contents.compressions.add(compression)
        if record.end > self._file.size and compression == 'none':
            return  # its records follow, one by one
        run = Run(record.position, record.position + len(data))
        for fields, body in piece_records(self._file, record.position, data, self._findings):
            self._enter_record(fields, body, run)
        run.end_in(self.contents.pieces)

    def _enter_record(self, fields: dict[bytes, bytes], body: Buffer, run: Run) -> None:
        if opcode_of(fields) == MESSAGE:
            channel_id, stamp_ns = parse_message(fields)
            self._stamps.setdefault(channel_id, array('Q')).append(stamp_ns)
            run.add(channel_id, stamp_ns)
        elif opcode_of(fields) == CONNECTION:
            try:
                channel_id, channel = parse_connection(fields, body)
            except ValueError as error:
                text = f'{self._file.name}: a connection is damaged ({error})'
                self._findings.lose(text)
            else:
                self.contents.channels[channel_id] = channel

    def _end_run(self) -> None:
        self._run.end_in(self.contents.pieces)
        self._run = Run(0)


def parse_connection(fields: dict[bytes, bytes], body: Buffer) -> tuple[int, Ros1Channel]:
    """Parse a connection and its id.

    Raises:
        ValueError: The connection is damaged.
    """
    described = parse_fields(body)
    try:
        topic, msgtype = fields[b'topic'].decode(), described[b'type'].decode()
        definition = described[b'message_definition'].decode(errors='replace')
        md5sum = described[b'md5sum'].decode('ascii')
    except KeyError as error:
        raise ValueError(f'it lacks {error}') from error
    caller = described.get(b'callerid')
    latched = described.get(b'latching') == b'1'
    return int.from_bytes(fields[b'conn'], 'little'), Ros1Channel(
        '/' * topic.startswith('/') + '/'.join(filter(None, topic.split('/'))),
        normalize_msgtype(msgtype),
        'ros1',
        definition,
        'ros1msg',
        md5sum,
        None if caller is None else caller.decode(errors='replace'),
        **(latched_qos() if latched else {}),
    )


def piece_records(
    file: FileBytes, position: int, data: Buffer, findings: Findings, cost: int | None = None
) -> Iterator[tuple[dict[bytes, bytes], memoryview]]:
    """Yield the records of a piece, header fields and data; skip damaged bytes.

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
        if is_chunk(view):
            records, whole = unpack_chunk(view)
            view = memoryview(records)
    except ValueError as error:
        findings.lose(f'{place} ({error})', cost)
        return
    for fields, start, stop in split_records(view):
        yield fields, view[start:stop]
        end = stop

    def lose(start: int, stop: int) -> None:
        findings.lose(f'{place} (bytes {start} to {stop} of it)')

    if whole:
        for record in walk(ROS1, HeldBytes(view), end, len(view), lose):
            if record.end <= len(view):
                fields, start, stop = split_record(view, record.position)
                yield fields, view[start:stop]
            else:
                lose(record.position, len(view))


def is_chunk(data: Buffer) -> bool:
    """Whether bytes begin with a chunk."""
    try:
        return opcode_of(split_record(data, 0)[0]) == CHUNK
    except ValueError:
        return False
