# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An MCAP file open for reading: by its summary, or by a scan if the summary is missing."""

from __future__ import annotations

import re
import struct
from array import array
from io import BytesIO
from sys import intern
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from ..files.local_files import crc32
from ..model.errors import BadBagError
from .chunked_file import ChunkedFile, ChunkScan, FileContents, open_bytes
from .container_file import Chunk, StoredChannel, latched_qos, offered_qos, ros2_spelling
from .decompression import UNCOMPRESSED, LimitError, decompress, decompress_beginning
from .mcap_writer import MAGIC
from .records import DamagedHeadError, Kind, Record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from .chunked_file import Run
    from .container_file import FileBytes, NamedFile, Problems, StoredMessage, Wanted
    from .decompression import Buffer, DescriptionLimits
    from .records import Source


# Parsers of the records of an MCAP file; their layouts are documented in mcap_chunk.

RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQHIQQ')
MESSAGE_BODY = struct.Struct('<HIQQ')
_SHORTEST = MESSAGE_BODY.size
_CHUNK = struct.Struct('<QQQII')
INDEX_BODY = struct.Struct('<HI')
_LENGTH = struct.Struct('<Q')
# Chunk Index: start and end time, offset and length of the chunk, bytes of the entries that follow
# (channel, offset of its message index); then the length of all message indexes, the compression.
_CHUNK_INDEX = struct.Struct('<QQQQI')
_CHUNK_INDEX_ENTRY = struct.Struct('<HQ')
_INDEX_LENGTHS = struct.Struct('<QI')
_ENTRY_SIZE = 16  # of a message index: stamp, offset
_HEAD_BYTES = RECORD_HEAD.size + 64
_LONGEST_NAME = 16  # of a compression
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_FIRST_PRIVATE = 0x80
# The least length of each record's body in bytes: that of an empty one.
_LEAST: dict[int, int] = {
    Opcode.HEADER: 8,
    Opcode.FOOTER: 20,
    Opcode.SCHEMA: 14,
    Opcode.CHANNEL: 16,
    Opcode.MESSAGE: 22,
    Opcode.CHUNK: 40,
    Opcode.MESSAGE_INDEX: 6,
    Opcode.CHUNK_INDEX: 64,
    Opcode.ATTACHMENT: 36,
    Opcode.ATTACHMENT_INDEX: 48,
    Opcode.STATISTICS: 46,
    Opcode.METADATA: 8,
    Opcode.METADATA_INDEX: 20,
    Opcode.SUMMARY_OFFSET: 17,
    Opcode.DATA_END: 4,
}
_FIXED = {Opcode.FOOTER, Opcode.SUMMARY_OFFSET, Opcode.DATA_END}
# Records with inner lengths that must agree.
_CHECKED = {*_FIXED, Opcode.CHUNK, Opcode.MESSAGE_INDEX}


class ChunkHead(NamedTuple):
    """The head of a chunk; records_at is relative to the start of the chunk record."""

    size: int
    crc: int
    compression: str
    records_at: int
    records_size: int


def parse_chunk_head(record: Buffer) -> ChunkHead:
    """Parse the head of a chunk from its record.

    Raises:
        DamagedHeadError: The head is damaged or truncated.
    """
    at = RECORD_HEAD.size
    try:
        _, _, size, crc, name_length = _CHUNK.unpack_from(record, at)
        at += _CHUNK.size
        if name_length > _LONGEST_NAME:
            raise DamagedHeadError
        name = bytes(record[at : at + name_length]).decode('ascii')
        (stored,) = _LENGTH.unpack_from(record, at + name_length)
    except (struct.error, UnicodeDecodeError) as error:
        raise DamagedHeadError from error
    if name in UNCOMPRESSED and size != stored:
        raise DamagedHeadError
    return ChunkHead(size, crc, name, at + name_length + _LENGTH.size, stored)


def parse_chunk_index(body: Buffer) -> tuple[Chunk, str, int]:
    """Parse a Chunk Index record: the chunk, its compression, the bytes of its message indexes.

    Raises:
        ValueError, struct.error: The record is damaged.
    """
    start_ns, end_ns, position, length, size = _CHUNK_INDEX.unpack_from(body)
    after = _CHUNK_INDEX.size + size
    index_length, name_length = _INDEX_LENGTHS.unpack_from(body, after)
    after += _INDEX_LENGTHS.size
    name = bytes(body[after : after + name_length]).decode()
    entries = _CHUNK_INDEX_ENTRY.iter_unpack(body[_CHUNK_INDEX.size : _CHUNK_INDEX.size + size])
    starts = sorted((start, key) for key, start in entries)
    end = position + length + index_length
    head = RECORD_HEAD.size + INDEX_BODY.size
    counts = {}
    for start, key in reversed(starts):
        counts[key] = (end - start - head) // _ENTRY_SIZE
        end = start
    return Chunk(start_ns, end_ns, position, length, counts), name, index_length


def agrees(data: Buffer, crc: int) -> bool:
    """Return whether bytes match a checksum; 0 is no checksum."""
    return crc in (0, crc32(data))


def split_records(records: Buffer) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of the body of consecutive records, up to a damaged one."""
    view = memoryview(records)
    position, end = 0, len(view)
    while end - position >= RECORD_HEAD.size:
        opcode, length = RECORD_HEAD.unpack_from(view, position)
        following = position + RECORD_HEAD.size + length
        if following > end or opcode == 0 or (opcode == _MESSAGE_OPCODE and length < _SHORTEST):
            return
        yield opcode, position + RECORD_HEAD.size, following
        position = following


def messages_in(
    records: Buffer,
    wanted: Wanted,
    describe: Callable[[int, Buffer], None],
) -> tuple[list[StoredMessage], int]:
    """Return the requested messages, and the end of the last record that can be split.

    Args:
        records: The records of a chunk.
        wanted: The requested messages.
        describe: Called with opcode and body of each record that is no message.
    """
    view = memoryview(records)
    messages: list[StoredMessage] = []
    channel_ids, since_ns, until_ns = wanted
    position, end = 0, len(view)
    head_size, message_size, unpack = RECORD_HEAD.size, _MESSAGE.size, _MESSAGE.unpack_from
    # The same as split_records; inlined because reading spends its time here.
    while end - position >= message_size:
        opcode, length, channel_id, _, stamp_ns, _ = unpack(view, position)
        following = position + head_size + length
        if following > end or opcode == 0 or (opcode == _MESSAGE_OPCODE and length < _SHORTEST):
            return messages, position
        if opcode != _MESSAGE_OPCODE:
            describe(opcode, view[position + head_size : following])
        elif channel_id in channel_ids and since_ns <= stamp_ns <= until_ns:
            messages.append((stamp_ns, channel_id, view[position + message_size : following]))
        position = following
    rest = position
    for opcode, start, following in split_records(view[rest:]):
        describe(opcode, view[rest + start : rest + following])
        position = rest + following
    return messages, position


class McapFormat:
    """The record format of MCAP; the head of a record is its opcode."""

    start = len(MAGIC)
    chunk = int(Opcode.CHUNK)
    message = _MESSAGE_OPCODE
    longest_message_head = _MESSAGE.size
    candidate = re.compile(rb'(?=[\x03-\x0f].{5}\0\0\0)', re.DOTALL)
    longest = RECORD_HEAD.size
    row = 3

    def classify(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """Classify the bytes at a position."""
        head = source.read(position, min(_HEAD_BYTES, end - position))
        if len(head) < RECORD_HEAD.size:
            return Kind.CUT, Record(0, position, end + 1)
        opcode, length = RECORD_HEAD.unpack_from(head)
        record = Record(opcode, position, position + RECORD_HEAD.size + length)
        if not _agrees(opcode, length, head):
            return Kind.NONE, record
        return (Kind.WHOLE if record.end <= end else Kind.CUT), record

    def is_checked(self, opcode: int) -> bool:
        """Return whether records of an opcode contain a second length."""
        return opcode in _CHECKED

    def inside(self, source: Source, position: int) -> int | None:
        """Return the position of a chunk's first record, None if compressed or damaged."""
        try:
            head = parse_chunk_head(source.read(position, _HEAD_BYTES))
        except DamagedHeadError:
            return None
        return position + head.records_at if head.compression in UNCOMPRESSED else None

    def compression(self, record: Buffer) -> str:
        """Return the name of a chunk's compression."""
        return parse_chunk_head(record).compression

    def unpacked_size(self, data: Buffer) -> int:
        """Return the most bytes that unpack makes of a chunk."""
        return parse_chunk_head(data).size if data[:1] == _CHUNK_OPCODE else len(data)

    def unpack(self, data: Buffer) -> tuple[Buffer, bool]:
        """Return the records of a chunk, and whether it is whole."""
        if data[:1] != _CHUNK_OPCODE:
            return data, True
        head = parse_chunk_head(data)
        stored = memoryview(data)[head.records_at : head.records_at + head.records_size]
        if len(stored) < head.records_size:
            return decompress_beginning(head.compression, stored, head.size), False
        records = decompress(head.compression, stored, head.size)
        if not agrees(records, head.crc):
            raise ValueError('wrong checksum')
        return records, True

    def split_record(self, view: Buffer, position: int) -> tuple[int, int, int]:
        """Return a record's opcode, and the start and end of its body."""
        opcode, length = RECORD_HEAD.unpack_from(view, position)
        start = position + RECORD_HEAD.size
        return opcode, start, start + length

    split_records = staticmethod(split_records)

    def stored_message(self, head: int, body: memoryview) -> StoredMessage | None:
        """Return the message that a record is, None for others."""
        if head != _MESSAGE_OPCODE:
            return None
        channel_id, _, stamp_ns, _ = MESSAGE_BODY.unpack_from(body)
        return stamp_ns, channel_id, body[MESSAGE_BODY.size :]


def _agrees(opcode: int, length: int, head: Buffer) -> bool:
    """Return whether the opcode is known and the inner lengths agree with the record's."""
    if opcode not in _LEAST:
        return opcode >= _FIRST_PRIVATE
    if opcode in _FIXED:
        return length == _LEAST[opcode]
    if opcode == Opcode.MESSAGE_INDEX and len(head) >= RECORD_HEAD.size + INDEX_BODY.size:
        size = INDEX_BODY.unpack_from(head, RECORD_HEAD.size)[1]
        return bool(size == length - INDEX_BODY.size and size % 16 == 0)
    if opcode == Opcode.CHUNK and len(head) == _HEAD_BYTES:
        try:
            chunk = parse_chunk_head(head)
        except DamagedHeadError:
            return False
        return chunk.records_at + chunk.records_size == RECORD_HEAD.size + length
    return length >= _LEAST[opcode]


MCAP = McapFormat()


# The scan of an MCAP file, and the descriptions of its channels.


# Raised by the library on damaged records.
RECORD_ERRORS = (McapError, struct.error, UnicodeDecodeError, EOFError, LookupError, ValueError)
_NESTED = 'a chunk inside a chunk, where MCAP has none, is not read'


class _McapChannel(NamedTuple):
    """The content of a Channel record; the library's records take three times the memory."""

    topic: str
    schema_id: int
    encoding: str
    profiles: str
    latched: bool

    def contradicts(self, other: _McapChannel) -> bool:
        """Return whether another record describes another channel; QoS profiles may be missing."""
        return self[:3] != other[:3]


class Descriptions:
    """The schemas and channels of a file.

    The first of an id is used: chunks have a checksum, the copies in a damaged summary have none.

    Args:
        limits: Limits of their number.
    """

    def __init__(self, limits: DescriptionLimits) -> None:
        self._limits = limits
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
                self._limits.add(len(body))
            first = self._schemas.setdefault(schema.id, schema)
            return (
                '' if first == schema else _two_ways('schema', schema.id, first.name, schema.name)
            )
        if opcode == Opcode.CHANNEL:
            channel_id, channel = _parse_channel(body)
            if channel_id not in self._channels:
                self._limits.add(len(body))
            earlier = self._channels.setdefault(channel_id, channel)
            if earlier.contradicts(channel):
                return _two_ways('channel', channel_id, self._name(earlier), self._name(channel))
        return _NESTED if opcode == Opcode.CHUNK else ''

    def _name(self, channel: _McapChannel) -> str:
        schema = self._schemas.get(channel.schema_id)
        return f'{channel.topic} ({schema.name if schema else "no type"})'

    def channels(self) -> dict[int, StoredChannel]:
        """Return the channels by id."""
        texts = {key: schema.data.decode(errors='replace') for key, schema in self._schemas.items()}
        return {
            key: self._source_channel(channel, texts.get(channel.schema_id, ''))
            for key, channel in self._channels.items()
        }

    def _source_channel(self, channel: _McapChannel, definition: str) -> StoredChannel:
        schema = self._schemas.get(channel.schema_id)
        name = schema.name if schema else ''
        is_ros = channel.encoding in {'cdr', 'ros1'} and '/' in name
        return StoredChannel(
            channel.topic,
            ros2_spelling(name) if is_ros else name,
            channel.encoding,
            definition,
            schema.encoding if schema else '',
            schema=schema.data if schema and schema.encoding == 'protobuf' else b'',
            **(latched_qos() if channel.latched else offered_qos(channel.profiles)),
        )


def _parse_channel(body: Buffer) -> tuple[int, _McapChannel]:
    """Parse a Channel record and its id.

    Raises:
        RECORD_ERRORS: The record is damaged.
    """
    record = Channel.read(ReadDataStream(BytesIO(body)))
    profiles = record.metadata.get('offered_qos_profiles', '')
    encoding = intern(record.message_encoding)
    latched = encoding == 'ros1' and record.metadata.get('latching') == '1'
    return record.id, _McapChannel(record.topic, record.schema_id, encoding, profiles, latched)


def _two_ways(noun: str, number: int, first: str, second: str) -> str:
    """Return the text of a loss: what of a number is described again as something else."""
    return f'{noun} {number} is described in two ways, {first} and {second}; the first counts'


class McapScan(ChunkScan[int]):
    """A scan of an MCAP file.

    Args:
        file: The file to read.
        problems: Collects notes and losses.

    Attributes:
        described: The schemas and channels so far.
    """

    noun = 'channel'
    descriptions = (Opcode.SCHEMA, Opcode.CHANNEL)
    footer = Opcode.FOOTER
    data_end = Opcode.DATA_END

    def __init__(self, file: FileBytes, problems: Problems) -> None:
        super().__init__(file, problems, MCAP)
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
            self._problems.lose(f'{self._file.name}: a {kind} record is damaged ({error})')
        else:
            if clash:
                self._problems.lose(f'{self._file.name}: {clash}', None if clash is _NESTED else 0)

    def _channels(self) -> dict[int, StoredChannel]:
        return self.described.channels()


# An MCAP file open for reading: by its summary, or by a scan if the summary is missing.

_FOOTER = struct.Struct('<BQQQI')
_CRC_SIZE = 4


class McapFile(ChunkedFile[int]):
    """An MCAP file.

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
            raise BadBagError(file.name, 'does not begin as an MCAP file does')
        contents, self._described = _read_summary(data, problems) or _scan(data, problems)
        super().__init__(data, problems, contents, MCAP)
        self._index_lengths = contents.index_lengths
        self._clashes: dict[tuple[int, bytes], str] = {}

    def _messages_in(self, records: Buffer, wanted: Wanted) -> tuple[list[StoredMessage], int]:
        return messages_in(records, wanted, self._compare_description)

    def _compare_description(self, opcode: int, body: Buffer) -> None:
        """Enter a loss if a chunk describes a channel otherwise than others or the summary."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.CHUNK):
            return
        key = opcode, b'' if opcode == Opcode.CHUNK else bytes(body)
        if key not in self._clashes:
            self._clashes[key] = self._clash(*key)
        if self._clashes[key]:
            cost = None if opcode == Opcode.CHUNK else 0
            self._problems.lose(f'{self._file.name}: {self._clashes[key]}', cost)

    def _clash(self, opcode: int, body: bytes) -> str:
        """Return what a record in a chunk contradicts, empty for nothing."""
        try:
            return self._described.enter(opcode, body)
        except RECORD_ERRORS:
            return ''  # the summary has it

    def _expect_indexes(self, chunks: Sequence[Chunk]) -> None:
        for chunk in chunks:
            start = chunk.position + chunk.length
            self._file.expect(start, self._index_lengths[chunk.position])

    def _indexed(self, chunk: Chunk) -> dict[int, npt.NDArray[np.uint64]]:
        start = chunk.position + chunk.length
        block = self._file.read(start, self._index_lengths[chunk.position])
        indexed = {}
        for opcode, at, end in split_records(block):
            if opcode == Opcode.MESSAGE_INDEX:
                if end - at < INDEX_BODY.size:
                    raise ValueError('a message index is cut')
                channel_id, size = INDEX_BODY.unpack_from(block, at)
                entries = np.frombuffer(block[at + INDEX_BODY.size : end], '<u8')
                indexed[channel_id] = entries[: size // 16 * 2].reshape(-1, 2)
        return indexed

    def _scanned(self) -> Mapping[int, array[int]]:
        return McapScan(self._file, self._problems).run().stamps or {}


def _scan(file: FileBytes, problems: Problems) -> tuple[FileContents, Descriptions]:
    scan = McapScan(file, problems)
    return scan.run(), scan.described


def _read_summary(file: FileBytes, problems: Problems) -> tuple[FileContents, Descriptions] | None:
    """Parse the summary; None unless it indexes every message."""
    if file.size < _FOOTER.size + len(MAGIC):
        return None
    tail = file.read(file.size - _FOOTER.size - len(MAGIC), _FOOTER.size + len(MAGIC))
    if len(tail) < _FOOTER.size or not tail.endswith(MAGIC):
        return None
    opcode, length, start, _, crc = _FOOTER.unpack_from(tail)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER.size - RECORD_HEAD.size) or not start:
        return None
    try:
        section = file.read_part(start, file.size - len(MAGIC) - start)
        if not agrees(section[:-_CRC_SIZE], crc):
            text = f'its summary, at byte {start}, is damaged (wrong checksum)'
            problems.lose(f'{file.name}: {text}', 0)
            return None
        return _summarized(file, section, start)
    except RECORD_ERRORS:
        return None


def _summarized(
    file: FileBytes, section: bytes, start: int
) -> tuple[FileContents, Descriptions] | None:
    contents, described = FileContents(), Descriptions(file.limits.descriptions())
    message_count: int | None = None
    for opcode, position, end in file.limits.counted(start, split_records(section)):
        body = section[position:end]
        if opcode == Opcode.STATISTICS:
            statistics = Statistics.read(ReadDataStream(BytesIO(body)))
            message_count = statistics.message_count
            contents.attachments = statistics.attachment_count
        elif opcode == Opcode.CHUNK_INDEX:
            chunk, compression, index_length = parse_chunk_index(body)
            contents.compressions.add(compression)
            contents.chunks.append(chunk)
            contents.index_lengths[chunk.position] = index_length
        elif described.enter(opcode, body):
            return None  # the scan reports where it contradicts itself
    contents.channels = described.channels()
    indexed = sum(sum(chunk.counts.values()) for chunk in contents.chunks)
    has_channels = all(contents.channels.keys() >= chunk.counts.keys() for chunk in contents.chunks)
    spans = sorted(
        (chunk.position, chunk.position + chunk.length + contents.index_lengths[chunk.position])
        for chunk in contents.chunks
    )
    starts = [*(position for position, _ in spans[1:]), start]
    # Chunks and their indexes; each of those may otherwise be all of the file.
    apart = all(end <= after for (_, end), after in zip(spans, starts, strict=False))
    # Messages outside of chunks, or chunks without index, are found by a scan only.
    return (contents, described) if message_count == indexed and has_channels and apart else None
