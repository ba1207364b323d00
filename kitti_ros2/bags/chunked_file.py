# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of MCAP and ROS 1 files: records, some of which are chunks of more records.

A file is read by its index, or by a scan from its start if that is missing or damaged.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from ..files.remote import is_remote
from .container_file import (
    START_BYTES,
    BagFile,
    Chunk,
    FetchedChunk,
    FileBytes,
    MessageStart,
    UnreadMessage,
)
from .decompression import LimitError, Search
from .indexed_messages import LARGE, LEAST_APART, indexed_messages, read_starts
from .records import DamagedHeadError, Head, walk

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt

    from ..files.remote import RemotePath
    from .container_file import (
        FoundMessage,
        IndexedMessage,
        NamedFile,
        Problems,
        StoredChannel,
        StoredMessage,
        Wanted,
    )
    from .decompression import Buffer, FileLimits
    from .indexed_messages import StartOfMessage
    from .records import Record, RecordFormat


# A scan of an MCAP or ROS 1 file from its start, record by record, up to its end.
#
# It needs neither index nor summary nor footer, so it reads files that a recorder left truncated.
# Damaged bytes are skipped and entered as losses.

_LARGEST_RUN = 2**20
_NO_CHUNK = -1  # in place of a position
_COST_OF_CHUNK = 5  # in messages; it has 50 bytes at least


@dataclass
class FileContents:
    """The contents of a file.

    Attributes:
        channels: By id.
        chunks: Chunks, and runs of records outside of chunks.
        compressions: Names of the compressions found so far.
        stamps: Nanoseconds by channel id; None if they are in the indexes of the chunks only.
        index_lengths: Bytes of the indexes behind the chunk at a position, in MCAP.
        attachments: Number of attachments, as far as the index lists them.
    """

    channels: Mapping[int, StoredChannel] = field(default_factory=dict)
    chunks: list[Chunk] = field(default_factory=list)
    compressions: set[str] = field(default_factory=set)
    stamps: dict[int, array[int]] | None = None
    index_lengths: dict[int, int] = field(default_factory=dict)
    attachments: int = 0


class Run:
    """A chunk that grows while records are scanned: its byte range and message counts."""

    def __init__(self, start: int, end: int | None = None) -> None:
        self.end = start if end is None else end
        self._start = start
        self._counts: Counter[int] = Counter()
        self._start_ns = 2**64
        self._end_ns = 0

    def takes(self, record: Record) -> bool:
        """Return whether a record follows directly and the chunk stays small enough."""
        return record.position == self.end and record.end - self._start <= _LARGEST_RUN

    def add(self, channel_id: int, stamp_ns: int) -> None:
        """Enter a message."""
        self._counts[channel_id] += 1
        self._start_ns = min(self._start_ns, stamp_ns)
        self._end_ns = max(self._end_ns, stamp_ns)

    def end_in(self, chunks: list[Chunk], limits: FileLimits) -> None:
        """Append it to the chunks, unless it has no messages.

        Raises:
            LimitError: The chunks have too many.
        """
        if self._counts:
            limits.add_records(self._start, sum(self._counts.values()))
            length = self.end - self._start
            times = self._start_ns, self._end_ns
            chunks.append(Chunk(*times, self._start, length, self._counts))


class MemoryBytes:
    """Bytes in memory, by position."""

    def __init__(self, view: memoryview) -> None:
        self._view = view

    def read(self, position: int, length: int) -> memoryview:
        """Return `length` bytes, fewer at the end."""
        return self._view[position : position + length]


class ChunkScan(ABC, Generic[Head]):
    """A scan of a file.

    Args:
        file: The file to read.
        problems: Collects notes and losses.
        form: Its record format.

    Attributes:
        noun: The name of a channel in the format.
        descriptions: Opcodes of the records that describe channels.
        footer, data_end: Opcodes of the records at the end of the file and of its messages; None
            if the format has none.
    """

    noun: ClassVar[str]
    descriptions: ClassVar[Collection[int]]
    footer: ClassVar[int | None] = None
    data_end: ClassVar[int | None] = None

    def __init__(self, file: FileBytes, problems: Problems, form: RecordFormat[Head]) -> None:
        self._file = file
        self._problems = problems
        self._form = form
        self._chunks: list[Chunk] = []
        self._compressions: set[str] = set()
        self._stamps: dict[int, array[int]] = {}
        self._run = Run(0)
        self._cut_at: int | None = None
        self._read = 'what comes before'
        self._refused: LimitError | None = None  # why descriptions are not kept

    def run(self) -> FileContents:
        """Scan the file once.

        Raises:
            OSError: The file cannot be read.
        """
        file = self._file
        try:
            ended = self._walk()
        except LimitError as error:
            self._problems.lose(f'{file.name}: {error}; what follows is not read')
            ended = True
        if not ended and (self.footer is not None or self._cut_at is not None):
            where = '' if self._cut_at is None else f', in the record at {self._cut_at}'
            text = f'{file.name}: cut off at byte {file.size}{where}; {self._read} was read'
            self._problems.lose(text, 0 if self._read == 'every message' else None)
        channels = self._channels()
        left_out = {
            key: len(self._stamps.pop(key)) for key in self._stamps.keys() - channels.keys()
        }
        if self._refused is not None:
            text = f'{file.name}: {self._refused}; the messages of all others are left out'
            self._problems.lose(text, sum(left_out.values()))
        else:
            for channel_id, count in left_out.items():
                text = f'{self.noun} {channel_id} is not described; its messages are left out'
                self._problems.lose(f'{file.name}: {text}', count)
        return FileContents(channels, self._chunks, self._compressions, self._stamps)

    def _walk(self) -> bool:
        """Enter all records; return whether the end of the file is valid.

        Raises:
            LimitError: There are too many.
        """
        file, others = self._file, 0
        search = Search(file.limits, _NO_CHUNK)
        for record in walk(self._form, file, self._form.start, file.size, self._lose_bytes, search):
            if record.opcode == self.footer and record.end <= file.size:
                self._check_end(record.end)
                self._end_run()
                return True
            if record.opcode != self._form.message:
                others += _COST_OF_CHUNK if record.opcode == self._form.chunk else 1
                file.limits.add_records(_NO_CHUNK, others)
            self._enter(record)
        self._end_run()
        return False

    def _check_end(self, end: int) -> None:
        """Enter a loss if more than the closing magic bytes is behind the footer."""
        end += self._form.start
        if self._file.size > end:
            self._problems.lose(
                f'{self._file.name}: it ends at byte {end}, and what follows is not read; if files'
                f' were joined there, take them apart'
            )

    def _lose_bytes(self, start: int, end: int) -> None:
        self._problems.lose(f'{self._file.name}: bytes {start} to {end} are damaged')

    def _enter(self, record: Record) -> None:
        whole = record.end <= self._file.size
        if not whole and self._cut_at is None:
            self._cut_at = record.position
        if record.opcode == self._form.chunk:
            self._end_run()
            self._enter_chunk(record)
        elif whole and record.opcode in (self._form.message, *self.descriptions):
            size = record.end - record.position
            if record.opcode == self._form.message:
                size = min(size, self._form.longest_message_head)
            data = self._file.read(record.position, size)
            if not self._run.takes(record):
                self._end_run()
                self._run = Run(record.position)
            self._run.end = record.end
            head, start, end = self._form.split_record(data, 0)
            self._enter_record(head, memoryview(data)[start:end], self._run)
        elif whole and record.opcode == self.data_end:
            self._read = 'every message'

    def _enter_chunk(self, record: Record) -> None:
        data = self._file.read(record.position, record.end - record.position)
        try:
            self._compressions.add(self._form.compression(data))
        except DamagedHeadError:
            return  # truncated before its records
        cut = record.end > self._file.size
        if cut and self._form.inside(self._file, record.position) is not None:
            return  # its records follow, one by one
        run = Run(record.position, record.position + len(data))
        for head, body in chunk_records(
            self._form, self._file, record.position, data, self._problems
        ):
            self._enter_record(head, body, run)
        run.end_in(self._chunks, self._file.limits)

    def _end_run(self) -> None:
        self._run.end_in(self._chunks, self._file.limits)
        self._run = Run(0)

    @abstractmethod
    def _enter_record(self, head: Head, body: Buffer, run: Run) -> None:
        """Enter a message into the stamps and a run, or the description of a channel."""

    @abstractmethod
    def _channels(self) -> Mapping[int, StoredChannel]:
        """Return the channels found, by id."""


def unpack(
    form: RecordFormat[Any], file: FileBytes, position: int, data: Buffer
) -> tuple[Buffer, bool]:
    """Unpack a chunk as RecordFormat.unpack does, within the limits of its file.

    Raises:
        DamagedHeadError: The head of the chunk is damaged.
        ValueError: The chunk is damaged, or too large together with others.
    """
    file.limits.add_block(position, form.unpacked_size(data))
    return form.unpack(data)


def chunk_records(
    form: RecordFormat[Head],
    file: FileBytes,
    position: int,
    data: Buffer,
    problems: Problems,
    cost: int | None = None,
) -> Iterator[tuple[Head, memoryview]]:
    """Yield the records of a chunk, head and body; skip damaged bytes.

    Args:
        form: The format of the records.
        file: The file of the chunk.
        position: The offset of its first byte.
        data: A chunk, or records outside of chunks.
        problems: Collects notes and losses.
        cost: Number of messages lost if nothing of it can be read.
    """
    which = f'{file.name}: the chunk at byte {position} is damaged'
    view, done, whole = memoryview(data), 0, True
    try:
        records, whole = unpack(form, file, position, view)
        view = memoryview(records)
        for head, start, end in file.limits.counted(position, form.split_records(view)):
            yield head, view[start:end]
            done = end
    except DamagedHeadError:
        pass  # if it is not compressed, its records can be found below
    except ValueError as error:
        problems.lose(f'{which} ({error})', cost)
        return

    def lose(start: int, stop: int) -> None:
        problems.lose(f'{which} (bytes {start} to {stop} of it)')

    if whole:
        search = Search(file.limits, position)
        try:
            for record in walk(form, MemoryBytes(view), done, len(view), lose, search):
                if record.end <= len(view):
                    head, start, end = form.split_record(view, record.position)
                    yield head, view[start:end]
                else:
                    lose(record.position, len(view))
        except LimitError as error:
            problems.lose(f'{which} ({error})')


# A bag's file opened by position, on a disk or in a store.


class RemoteFileBytes(FileBytes):
    """The bytes of a file in a store.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    waits = True

    def __init__(self, path: RemotePath, name: Path) -> None:
        from ..files.remote_reads import RemoteBytes  # noqa: PLC0415 - for URLs only

        self.name = name
        self._bytes = RemoteBytes(path)
        self.size = self._bytes.size

    def read(self, position: int, length: int) -> bytes:
        """Read as FileBytes does."""
        return self._bytes.read(position, length)

    def expect(self, position: int, length: int) -> None:
        """Request bytes that will be read."""
        self._bytes.expect(position, length)

    def is_cut(self) -> bool:
        """Return false: objects are replaced, never truncated."""
        return False

    def close(self) -> None:
        """Do nothing: no connection stays open."""


def open_bytes(file: NamedFile) -> FileBytes:
    """Open a file, on a disk or in a store.

    Raises:
        OSError, RemoteError: It cannot be opened.
    """
    if is_remote(file.path):
        return RemoteFileBytes(file.path, file.name)
    return FileBytes(file)


# The common part of MCAP and ROS 1 files: chunks, with or without an index at the end.

_INDEXES_AHEAD = 16
_MOST_UNPACKED = 2**23  # before its turn: some chunks are made to fill the memory


class ChunkedFile(BagFile, Generic[Head]):
    """A BagFile that consists of chunks.

    Args:
        file: The bytes.
        problems: Collects notes and losses.
        contents: From the file's index, or from a scan of the file.
        form: The format of the records.
    """

    def __init__(
        self, file: FileBytes, problems: Problems, contents: FileContents, form: RecordFormat[Head]
    ) -> None:
        self.channels = contents.channels
        self.chunks = contents.chunks
        self.compressions: set[str] = contents.compressions
        self.attachments = contents.attachments
        self._stamps = contents.stamps
        self._file = file
        self._problems = problems
        self._form = form
        self.fetches = not file.waits
        self._recent: Mapping[int, FetchedChunk] = {}  # the last two that single messages were of

    def fetch(self, chunk: Chunk) -> FetchedChunk:
        """Read a chunk, and unpack it unless it is large, on any thread."""
        data = self._file.read(chunk.position, chunk.length)
        with suppress(ValueError):  # read reports the damage
            if self._form.unpacked_size(data) <= _MOST_UNPACKED:
                return FetchedChunk(data, unpack(self._form, self._file, chunk.position, data))
        return FetchedChunk(data, None)

    def read(
        self,
        chunk: Chunk,
        wanted: Wanted,
        fetched: FetchedChunk | Sequence[IndexedMessage] | None = None,
    ) -> Iterator[FoundMessage]:
        """Return the requested messages in a chunk, in time order."""
        if fetched is not None and not isinstance(fetched, FetchedChunk):
            starts = read_starts(self._form, self._file, fetched)
            if starts is not None:
                return map(self._message, fetched, starts)
            fetched = None  # what is wrong is found where the whole chunk is read
        if fetched is None and wanted.since_ns == wanted.until_ns:
            # What is near to a single message is likely to be read next.
            fetched = self._recent.get(chunk.position) or self.fetch(chunk)
            self._recent = {**dict([*self._recent.items()][-1:]), chunk.position: fetched}
        elif fetched is None:
            fetched = FetchedChunk(self._file.read(chunk.position, chunk.length), None)
        data, unpacked = fetched
        end = chunk.position + len(data)
        try:
            records, whole = unpacked or unpack(self._form, self._file, chunk.position, data)
            messages, done = self._messages_in(records, wanted)
            self._file.limits.add_records(chunk.position, len(messages))
            sound = whole and done == len(records)
        except ValueError:
            messages, sound = [], False
        messages.sort(key=itemgetter(0))  # costs little if it is sorted already
        if len(data) < chunk.length:
            self._problems.lose(f'{self._file.name}: cut off at byte {end} while it was read')
        elif sound and wanted.since_ns <= chunk.start_ns and chunk.end_ns <= wanted.until_ns:
            self._compare(chunk, wanted.channel_ids, messages)
        if not sound or len(data) < chunk.length:
            cost = sum(chunk.counts[key] for key in chunk.counts.keys() & set(wanted.channel_ids))
            salvaged = self._salvaged(chunk.position, data, cost)
            messages = [message for message in salvaged if wanted.takes(message[0], message[1])]
            messages.sort(key=itemgetter(0))
        return iter(messages)

    def select(self, chunk: Chunk, wanted: Wanted) -> Sequence[IndexedMessage] | None:
        """Find requested messages by the index of a chunk; None if the chunk is to be read whole.

        That is one of which much is requested, a compressed one, or one whose index is damaged. In
        a store each read waits as long as that of a chunk.
        """
        count = sum(number for key, number in chunk.counts.items() if key in wanted.channel_ids)
        is_indexed = self._stamps is None and not self._file.waits
        if self.whole_chunks or not is_indexed or chunk.length < count * LEAST_APART:
            return None
        try:
            records_at = self._form.inside(self._file, chunk.position)
            indexed = {} if records_at is None else self._indexed(chunk)
        except (ValueError, KeyError):
            return None
        if chunk.counts != {channel_id: len(entries) for channel_id, entries in indexed.items()}:
            return None
        messages = indexed_messages(indexed, chunk, records_at or 0)
        requested = (m for m in messages if wanted.takes(m.stamp_ns, m.channel_id))
        selected = sorted(requested)
        most = START_BYTES if self.is_start_enough is not None else chunk.length
        sizes = (message.end - message.position for message in selected)
        size = sum(min(size, most) if size >= LARGE else size for size in sizes)
        return selected if messages and 2 * size <= chunk.length else None

    def _message(self, message: IndexedMessage, start: StartOfMessage) -> FoundMessage:
        """Return a message of which the start is read."""
        data: Buffer | UnreadMessage = bytes(start.data)
        if len(start.data) < start.size:
            data = UnreadMessage(partial(self._completed, message.channel_id, start))
        return message.stamp_ns, message.channel_id, data

    def _completed(self, channel_id: int, start: StartOfMessage) -> Buffer | None:
        if self._wants_start(channel_id, start.data):
            return MessageStart.of(start.data, start.size)
        data = self._file.read(start.position, start.size)
        if len(data) == start.size:
            return data
        end = start.position + len(data)
        self._problems.lose(f'{self._file.name}: cut off at byte {end} while it was read')
        return None

    def _compare(
        self, chunk: Chunk, channel_ids: Collection[int], stored: Sequence[StoredMessage]
    ) -> None:
        """Enter a loss if a chunk and its index list different messages: one of them is damaged.

        Args:
            chunk: As the index lists it.
            channel_ids: Ids of the requested channels.
            stored: Their messages in the chunk, by time.
        """
        listed = {key: count for key, count in chunk.counts.items() if count and key in channel_ids}
        there = Counter(map(itemgetter(1), stored))
        outside = stored and not chunk.start_ns <= stored[0][0] <= stored[-1][0] <= chunk.end_ns
        if listed != there or outside:
            lost = sum((Counter(listed) - there).values())
            which = f'{self._file.name}: the chunk at byte {chunk.position}'
            self._problems.lose(f'{which} has other messages than its index lists', lost)

    def expect(self, chunk: Chunk) -> None:
        """Ask the system to read a chunk ahead of its turn."""
        self._file.expect(chunk.position, chunk.length)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _all_stamps(self) -> Iterable[tuple[int, npt.ArrayLike]]:
        """Return the stamps by channel from the file's index, or from a scan if that is damaged."""
        if self._stamps is not None:
            return self._stamps.items()
        joined: dict[int, array[int]] = {}  # thousands of chunks have one or two of a channel
        for number, chunk in enumerate(self.chunks):
            if self._file.waits:
                self._expect_indexes(self.chunks[number : number + _INDEXES_AHEAD])
            try:
                indexed = self._indexed(chunk)
            except ValueError:
                indexed = {}
            if chunk.counts != {channel_id: len(rows) for channel_id, rows in indexed.items()}:
                return self._scanned().items()
            for channel_id, entries in indexed.items():
                stamps = entries[:, 0].astype('u8').tobytes()
                joined.setdefault(channel_id, array('Q')).frombytes(stamps)
        return joined.items()

    def _salvaged(self, position: int, data: bytes, cost: int) -> Iterator[StoredMessage]:
        """Yield the recoverable messages of a damaged chunk in file order; enter the losses."""
        problems = self._problems
        for head, body in chunk_records(self._form, self._file, position, data, problems, cost):
            message = self._form.stored_message(head, body)
            if message is not None:
                yield message

    @abstractmethod
    def _messages_in(self, records: Buffer, wanted: Wanted) -> tuple[list[StoredMessage], int]:
        """Return requested messages of records, and the end of the last that can be split."""

    def _expect_indexes(self, chunks: Sequence[Chunk]) -> None:
        """Request the indexes of chunks from a store."""

    @abstractmethod
    def _indexed(self, chunk: Chunk) -> Mapping[int, npt.NDArray[np.integer[Any]]]:
        """Return (N, 2) stamps and offsets of the messages of a chunk by channel id: its index.

        Raises:
            ValueError: The index is damaged.
        """

    @abstractmethod
    def _scanned(self) -> Mapping[int, array[int]]:
        """Return the stamps by channel id, from a scan of the file."""
