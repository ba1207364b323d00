# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 .bag files (format 2.0): their records, and how they are read.

The format: http://wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import re
import struct
from array import array
from contextlib import suppress
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ..model.errors import BadBagError
from .chunked_file import ChunkedFile, ChunkScan, FileContents, open_bytes
from .container_file import Chunk, FileBytes, StoredChannel, latched_qos, ros2_spelling
from .decompression import UNCOMPRESSED, LimitError, decompress, decompress_beginning, largest_block
from .records import Kind, Record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy.typing as npt

    from .chunked_file import Run
    from .container_file import NamedFile, Problems, StoredMessage, Wanted
    from .decompression import Buffer, DescriptionLimits, FileLimits
    from .records import Source


# Parsers of the records of a ROS 1 .bag file (http://wiki.ros.org/Bags/Format/2.0).
#
# Little endian; every record is a header's length (uint32), the header, the data's length (uint32)
# and the data. A header is a sequence of fields, each its length (uint32) and ``name=value``; the
# field op is the record's kind. Messages are in chunks; each chunk is followed by the indexes of
# its messages; the file ends with all connections and the summaries of the chunks.

MESSAGE, BAG_HEADER, INDEX, CHUNK, CHUNK_INFO, CONNECTION = range(2, 8)
MAGIC = b'#ROSBAG V2.0\n'

Fields: TypeAlias = 'dict[bytes, bytes]'
"""Fields of a record's header, by name."""

_UINT32 = struct.Struct('<I')
_TIME = struct.Struct('<II')
_LONGEST_HEADER = 2**16
_HEAD_READ = 256
# The required fields of each kind of record with their sizes, and the data size per count.
_NEEDED: dict[int, dict[bytes, int | None]] = {
    MESSAGE: {b'conn': 4, b'time': 8},
    BAG_HEADER: {b'index_pos': 8, b'conn_count': 4, b'chunk_count': 4},
    INDEX: {b'ver': 4, b'conn': 4, b'count': 4},
    CHUNK: {b'compression': None, b'size': 4},
    CHUNK_INFO: {b'ver': 4, b'chunk_pos': 8, b'start_time': 8, b'end_time': 8, b'count': 4},
    CONNECTION: {b'conn': 4, b'topic': None},
}
_ENTRY_SIZES = {INDEX: 12, CHUNK_INFO: 8}

# A message's header as recorders write it, with its fields in any order, and its data's length.
_MESSAGE_HEAD = re.compile(
    rb'\x26\0\0\0(?:\x09\0\0\0conn=(.{4})|\x04\0\0\0op=\x02|\x0d\0\0\0time=(.{8})){3}(.{4})',
    re.DOTALL,
)
# The first field of any record that a search may begin with: chunks, messages, connections.
_FIELD = (
    rb'(?:\x04\0\0\0op=|.\0\0\0compression=|\x09\0\0\0(?:conn|size)=|\x0d\0\0\0time=|...\0topic=)'
)


def parse_time(value: Buffer) -> int:
    """Return a time in nanoseconds."""
    seconds, nanoseconds = _TIME.unpack(value)
    return int(seconds) * 10**9 + int(nanoseconds)


def parse_fields(header: Buffer) -> Fields:
    """Parse the fields of a header, by name.

    Raises:
        ValueError: The header is invalid.
    """
    data = bytes(header)
    fields = {}
    position = 0
    while position < len(data):
        if position + 4 > len(data):
            raise ValueError('a field is cut')
        (size,) = _UINT32.unpack_from(data, position)
        position += 4
        name, equals, value = data[position : position + size].partition(b'=')
        position += size
        if not equals or position > len(data):
            raise ValueError('a field is cut')
        fields[name] = value
    return fields


def split_record(view: Buffer, position: int) -> tuple[Fields, int, int]:
    """Return a record's header fields, and the start and end of its data, which may be truncated.

    Raises:
        ValueError: The header is invalid or truncated.
    """
    if position + 4 > len(view):
        raise ValueError('cut')
    (size,) = _UINT32.unpack_from(view, position)
    start = position + 4 + size
    if size > _LONGEST_HEADER:
        raise ValueError('no header')
    if start + 4 > len(view):
        raise ValueError('cut')
    fields = parse_fields(view[position + 4 : start])
    (length,) = _UINT32.unpack_from(view, start)
    return fields, start + 4, start + 4 + int(length)


def split_records(view: Buffer) -> Iterator[tuple[Fields, int, int]]:
    """Yield consecutive records, up to the first damaged one."""
    position = 0
    while position < len(view):
        try:
            fields, start, position = split_record(view, position)
        except ValueError:
            return
        if position > len(view) or not opcode_of(fields):
            return
        yield fields, start, position


def opcode_of(fields: Fields) -> int:
    """Return the kind of a record, 0 if its fields are invalid."""
    opcode = int.from_bytes(fields.get(b'op', b'\0'), 'little')
    for name, size in _NEEDED.get(opcode, {b'': None}).items():
        if name not in fields or (size is not None and len(fields[name]) != size):
            return 0
    return opcode


def messages_in(
    records: Buffer,
    wanted: Wanted,
    describe: Callable[[Fields, Buffer], None],
) -> tuple[list[StoredMessage], int]:
    """Return the requested messages, and the end of the last record that can be split.

    Args:
        records: The records of a chunk.
        wanted: The requested messages.
        describe: Called with header and data of each connection record.
    """
    view = memoryview(records)
    messages: list[StoredMessage] = []
    channel_ids, since_ns, until_ns = wanted
    position, end = 0, len(view)
    match_head = _MESSAGE_HEAD.match
    while position < end:
        head = match_head(view, position)
        if head is not None:
            conn, time, size = head.groups()
            start = head.end()
            following = start + int.from_bytes(size, 'little')
            if conn is None or time is None or following > end:
                break
            channel_id = int.from_bytes(conn, 'little')
            if channel_id in channel_ids and since_ns <= (stamp_ns := parse_time(time)) <= until_ns:
                messages.append((stamp_ns, channel_id, view[start:following]))
            position = following
            continue
        record = _record_at(view, position)
        if record is None:
            break
        fields, start, following = record
        if opcode_of(fields) == MESSAGE:
            channel_id, stamp_ns = parse_message(fields)
            if wanted.takes(stamp_ns, channel_id):
                messages.append((stamp_ns, channel_id, view[start:following]))
        elif opcode_of(fields) == CONNECTION:
            describe(fields, view[start:following])
        position = following
    return messages, position


def _record_at(view: memoryview, position: int) -> tuple[Fields, int, int] | None:
    """Return the record at a position as split_record does; None unless it is whole."""
    try:
        fields, start, following = split_record(view, position)
    except ValueError:
        return None
    return (fields, start, following) if opcode_of(fields) and following <= len(view) else None


class _ChunkRecord(NamedTuple):
    """A chunk: the size of its records, and where they are stored in it."""

    compression: str
    size: int
    start: int
    end: int


def _parse_chunk(data: Buffer) -> _ChunkRecord | None:
    """Parse the head of a chunk; None if data begin with another record."""
    try:
        fields, start, end = split_record(data, 0)
    except ValueError:
        return None
    if opcode_of(fields) != CHUNK:
        return None
    compression = fields[b'compression'].decode('ascii', 'replace')
    return _ChunkRecord(compression, _UINT32.unpack(fields[b'size'])[0], start, end)


def parse_message(fields: Fields) -> tuple[int, int]:
    """Return the connection and stamp of a message."""
    return int.from_bytes(fields[b'conn'], 'little'), parse_time(fields[b'time'])


class Ros1Format:
    """The record format of ROS 1 bags; the head of a record is its header's fields."""

    start = len(MAGIC)
    chunk = CHUNK
    message = MESSAGE
    longest_message_head = _HEAD_READ
    candidate = re.compile(rb'(?=..\0\0' + _FIELD + rb')', re.DOTALL)
    longest = 32
    row = 1  # names of fields are no coincidence

    def classify(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """Classify the bytes at a position."""
        head = source.read(position, min(_HEAD_READ, end - position))
        size = int.from_bytes(head[:4], 'little')
        if size > _LONGEST_HEADER:
            return Kind.NONE, Record(0, position, position)
        needed = 4 + size + 4
        if needed > len(head):
            head = source.read(position, min(needed, end - position))
        if needed > len(head):
            return Kind.CUT, Record(0, position, end + 1)
        try:
            fields, start, stop = split_record(head, 0)
        except ValueError:
            return Kind.NONE, Record(0, position, position)
        record = Record(opcode_of(fields), position, position + stop)
        if not _agrees(record.opcode, fields, stop - start):
            return Kind.NONE, record
        unset = record.opcode == CHUNK and fields[b'size'] == bytes(4)
        if unset and not _begins_after_chunk(source.read(record.end, _HEAD_READ)):
            # A chunk that its recorder did not finish extends to the end.
            record = record._replace(end=end + 1)
        return (Kind.WHOLE if record.end <= end else Kind.CUT), record

    def is_checked(self, opcode: int) -> bool:
        """Return whether records of an opcode contain a second length."""
        return opcode in _ENTRY_SIZES

    def inside(self, source: Source, position: int) -> int | None:
        """Return the position of a chunk's first record, None if the chunk is compressed."""
        fields, start, _ = split_record(source.read(position, _HEAD_READ), 0)
        return position + start if fields[b'compression'] == b'none' else None

    def compression(self, record: Buffer) -> str:
        """Return the name of a chunk's compression."""
        return split_record(record, 0)[0][b'compression'].decode('ascii', 'replace')

    def unpacked_size(self, data: Buffer) -> int:
        """Return the most bytes that unpack makes of a chunk."""
        chunk = _parse_chunk(data)
        if chunk is None:
            return len(data)
        # decompress_beginning is bounded by the same where the size is not known.
        return chunk.size or largest_block(len(data))

    def unpack(self, data: Buffer) -> tuple[Buffer, bool]:
        """Return the records of a chunk, and whether it is whole."""
        chunk = _parse_chunk(data)
        if chunk is None:
            return data, True
        compression, size, start, end = chunk
        stored = memoryview(data)[start:]
        if size == 0 or end - start > len(stored):
            # Recorders write the size once the chunk is full.
            return decompress_beginning(compression, stored, size), False
        return decompress(compression, stored[: end - start], size), True

    split_record = staticmethod(split_record)
    split_records = staticmethod(split_records)

    def stored_message(self, head: Fields, body: memoryview) -> StoredMessage | None:
        """Return the message that a record is, None for others."""
        if opcode_of(head) != MESSAGE:
            return None
        channel_id, stamp_ns = parse_message(head)
        return stamp_ns, channel_id, body


def _begins_after_chunk(head: Buffer) -> bool:
    """Return whether a record begins that only follows a chunk: then the chunk is empty."""
    try:
        return opcode_of(split_record(head, 0)[0]) in {CHUNK, INDEX, CHUNK_INFO}
    except ValueError:
        return False


def _agrees(opcode: int, fields: Fields, length: int) -> bool:
    """Return whether the opcode is known and the header agrees with the data's length."""
    if opcode in _ENTRY_SIZES:
        (count,) = _UINT32.unpack(fields[b'count'])
        return bool(length == count * _ENTRY_SIZES[opcode])
    if opcode == CHUNK and fields[b'compression'].decode('ascii', 'replace') in UNCOMPRESSED:
        return bool(length == _UINT32.unpack(fields[b'size'])[0])
    return opcode != 0


ROS1 = Ros1Format()


# The scan of a ROS 1 .bag file (or .bag.active), and the descriptions of its connections.


@dataclass(frozen=True)
class Ros1Channel(StoredChannel):
    """A connection.

    Attributes:
        md5sum: MD5 of the definition.
        callerid: The publisher's node.
    """

    md5sum: str = ''
    callerid: str | None = None


class DescribedConnections:
    """The connections of a file.

    Args:
        limits: Limits of their number.

    Attributes:
        by_id: The last description of each.
    """

    def __init__(self, limits: DescriptionLimits) -> None:
        self.by_id: dict[int, StoredChannel] = {}
        self._limits = limits

    def enter(self, fields: Fields, body: Buffer) -> None:
        """Enter a connection.

        Raises:
            LimitError: There are too many.
            ValueError: The connection is damaged.
        """
        channel_id, channel = parse_connection(fields, body)
        if channel_id not in self.by_id:
            self._limits.add(len(body))
        self.by_id[channel_id] = channel


class Ros1Scan(ChunkScan[Fields]):
    """A scan of a ROS 1 .bag file.

    Args:
        file: The file to read.
        problems: Collects notes and losses.
    """

    noun = 'connection'
    descriptions = (CONNECTION,)

    def __init__(self, file: FileBytes, problems: Problems) -> None:
        super().__init__(file, problems, ROS1)
        self._connections = DescribedConnections(file.limits.descriptions())

    def _enter_record(self, head: Fields, body: Buffer, run: Run) -> None:
        opcode = opcode_of(head)
        if opcode == MESSAGE:
            channel_id, stamp_ns = parse_message(head)
            self._stamps.setdefault(channel_id, array('Q')).append(stamp_ns)
            run.add(channel_id, stamp_ns)
        elif opcode == CONNECTION and self._refused is None:
            try:
                self._connections.enter(head, body)
            except LimitError as error:
                self._refused = error
            except ValueError as error:
                text = f'{self._file.name}: a connection is damaged ({error})'
                self._problems.lose(text)

    def _channels(self) -> dict[int, StoredChannel]:
        return self._connections.by_id


def parse_connection(fields: Fields, body: Buffer) -> tuple[int, Ros1Channel]:
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
        raise ValueError(f'it has no {error}') from error
    caller = described.get(b'callerid')
    latched = described.get(b'latching') == b'1'
    return int.from_bytes(fields[b'conn'], 'little'), Ros1Channel(
        '/' * topic.startswith('/') + '/'.join(filter(None, topic.split('/'))),
        ros2_spelling(msgtype),
        'ros1',
        definition,
        'ros1msg',
        md5sum,
        None if caller is None else caller.decode(errors='replace'),
        **(latched_qos() if latched else {}),
    )


# A ROS 1 .bag file open for reading: by its index, or by a scan if the index is missing.

_CHUNK_HEAD_READ = 4096
_COUNT = struct.Struct('<II')
_ENTRY = np.dtype([('seconds', '<u4'), ('nanoseconds', '<u4'), ('offset', '<u4')])


class Ros1File(ChunkedFile[Fields]):
    """A ROS 1 .bag file, format 2.0.

    Args:
        file: The file.
        problems: Collects notes and losses.

    Raises:
        BadBagError: The magic bytes are missing.
        OSError: The file cannot be read.
    """

    def __init__(self, file: NamedFile, problems: Problems) -> None:
        data = open_bytes(file)
        if data.read(0, len(MAGIC)) != MAGIC:
            raise BadBagError(file.name, 'does not begin as a ROS 1 bag of format 2.0 does')
        contents = _read_index(data, problems) or Ros1Scan(data, problems).run()
        super().__init__(data, problems, contents, ROS1)
        # Those of the file appear to readers as they are wanted: see stored_messages.ros_channel.
        self._as_stored = contents.channels
        if self.chunks:
            with suppress(ValueError):
                self._chunk_end(self.chunks[0])

    def _messages_in(self, records: Buffer, wanted: Wanted) -> tuple[list[StoredMessage], int]:
        return messages_in(records, wanted, self._compare_connection)

    def _compare_connection(self, fields: Fields, body: Buffer) -> None:
        """Enter a loss if a chunk and the index describe a connection differently."""
        try:
            channel_id, channel = parse_connection(fields, body)
        except ValueError as error:
            self._problems.lose(f'{self._file.name}: a connection is damaged ({error})', 0)
            return
        indexed = self._as_stored.get(channel_id)
        if indexed is not None and indexed != channel:
            both = f'{indexed.topic} ({indexed.msgtype}) and {channel.topic} ({channel.msgtype})'
            text = f'connection {channel_id} is described in two ways, {both}; the first counts'
            self._problems.lose(f'{self._file.name}: {text}', 0)

    def _indexed(self, chunk: Chunk) -> dict[int, npt.NDArray[np.int64]]:
        end = self._chunk_end(chunk)
        block = self._file.read(chunk.position + end, chunk.length - end)
        indexed = {}
        position = 0
        while position < len(block):
            fields, start, position = split_record(block, position)
            if opcode_of(fields) == INDEX:
                entries = np.frombuffer(block[start:position], _ENTRY)
                times = entries['seconds'].astype(np.int64) * 10**9 + entries['nanoseconds']
                channel_id = int.from_bytes(fields[b'conn'], 'little')
                indexed[channel_id] = np.stack([times, entries['offset'].astype(np.int64)], axis=1)
        return indexed

    def _chunk_end(self, chunk: Chunk) -> int:
        """Return the offset of the indexes behind the record of a chunk.

        Raises:
            ValueError: The chunk is damaged.
        """
        fields, _, end = split_record(self._file.read(chunk.position, _CHUNK_HEAD_READ), 0)
        if opcode_of(fields) == CHUNK:
            self.compressions.add(fields[b'compression'].decode('ascii', 'replace'))
        return end

    def _scanned(self) -> Mapping[int, array[int]]:
        return Ros1Scan(self._file, self._problems).run().stamps or {}


def _read_index(file: FileBytes, problems: Problems) -> FileContents | None:
    """Read the index at the end; None if it is missing or damaged."""
    try:
        fields, _, _ = split_record(file.read(len(MAGIC), _CHUNK_HEAD_READ), 0)
        start = int.from_bytes(fields.get(b'index_pos', b''), 'little')
        if start == 0 and opcode_of(fields) == BAG_HEADER:
            problems.lose(f'{file.name}: was not closed by its recorder', 0)
            return None
        if start > file.size:
            return None  # the scan reports where it is truncated
        section = file.read_part(start, file.size - start)
        return _indexed_contents(section, start, fields, file.limits)
    except LimitError:
        return None  # the scan reports what is left out
    except ValueError as error:
        problems.lose(f'{file.name}: its index is damaged ({error})', 0)
        return None


def _indexed_contents(
    section: bytes, start: int, header: Fields, limits: FileLimits
) -> FileContents:
    """Parse an index, which must list as many chunks as the bag's header.

    Raises:
        ValueError: The index is damaged, or lists more than the limits of the file allow.
    """
    if opcode_of(header) != BAG_HEADER:
        raise ValueError('the header does not tell where it is')
    expected = int.from_bytes(header[b'chunk_count'], 'little')
    connections = DescribedConnections(limits.descriptions())
    infos: list[tuple[int, int, int, dict[int, int]]] = []
    position = 0
    while position < len(section):
        fields, at, position = split_record(section, position)
        if position > len(section):
            raise ValueError('cut')
        body = section[at:position]
        opcode = opcode_of(fields)
        if opcode == CONNECTION:
            connections.enter(fields, body)
        elif opcode == CHUNK_INFO:
            times = parse_time(fields[b'start_time']), parse_time(fields[b'end_time'])
            if len(body) != _COUNT.size * int.from_bytes(fields[b'count'], 'little'):
                raise ValueError('a chunk with other connections than it counts')
            counts = dict(_COUNT.iter_unpack(body))
            limits.add_records(start, len(infos))
            infos.append((int.from_bytes(fields[b'chunk_pos'], 'little'), *times, counts))
    if len(infos) != expected:
        raise ValueError(f'{len(infos)} chunks instead of {expected}')
    if any(not counts.keys() <= connections.by_id.keys() for _, _, _, counts in infos):
        raise ValueError('a connection is missing')
    infos.sort(key=itemgetter(0))
    ends = [*(info[0] for info in infos[1:]), start][: len(infos)]
    chunks = [
        Chunk(start_ns, end_ns, begin, end - begin, counts)
        for (begin, start_ns, end_ns, counts), end in zip(infos, ends, strict=True)
    ]
    return FileContents(connections.by_id, chunks)
