# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan of an MCAP or ROS 1 file from its start, record by record, up to its end.

It needs neither index nor summary nor footer, so it reads files that a recorder left truncated.
Damaged bytes are skipped and entered as losses.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from .limits import LimitError, Search
from .pieces import Piece
from .record_walk import DamagedHeadError, Head, walk

if TYPE_CHECKING:
    from array import array
    from collections.abc import Collection, Iterator, Mapping

    from .findings import Findings
    from .limits import FileLimits
    from .pieces import Buffer, FileBytes, StoredChannel
    from .record_walk import Record, RecordFormat

_LARGEST_RUN = 2**20
_NO_PIECE = -1  # in place of a position
_COST_OF_CHUNK = 5  # in messages; it has 50 bytes at least


@dataclass
class FileContents:
    """The contents of a file.

    Attributes:
        channels: By id.
        pieces: Chunks, and runs of records outside of chunks.
        compressions: Names of the compressions found so far.
        stamps: Nanoseconds by channel id; None if they are in the indexes of the chunks only.
        index_lengths: Bytes of the indexes behind the piece at a position, in MCAP.
    """

    channels: Mapping[int, StoredChannel] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    compressions: set[str] = field(default_factory=set)
    stamps: dict[int, array[int]] | None = None
    index_lengths: dict[int, int] = field(default_factory=dict)


class Run:
    """A piece that grows while records are scanned: its byte range and message counts."""

    def __init__(self, start: int, end: int | None = None) -> None:
        self.end = start if end is None else end
        self._start = start
        self._counts: Counter[int] = Counter()
        self._start_ns = 2**64
        self._end_ns = 0

    def takes(self, record: Record) -> bool:
        """Whether a record follows directly and the piece stays small enough."""
        return record.position == self.end and record.end - self._start <= _LARGEST_RUN

    def add(self, channel_id: int, stamp_ns: int) -> None:
        """Enter a message."""
        self._counts[channel_id] += 1
        self._start_ns = min(self._start_ns, stamp_ns)
        self._end_ns = max(self._end_ns, stamp_ns)

    def end_in(self, pieces: list[Piece], limits: FileLimits) -> None:
        """Append it to the pieces, unless it has no messages.

        Raises:
            LimitError: The pieces have too many.
        """
        if self._counts:
            limits.add_records(self._start, sum(self._counts.values()))
            length = self.end - self._start
            times = self._start_ns, self._end_ns
            pieces.append(Piece(*times, self._start, length, self._counts))


class HeldBytes:
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
        findings: Damage is entered there.
        form: Its record format.

    Attributes:
        noun: What the format calls a channel.
        descriptions: Opcodes of the records that describe channels.
        footer, data_end: Opcodes of the records at the end of the file and of its messages; None
            if the format has none.
    """

    noun: ClassVar[str]
    descriptions: ClassVar[Collection[int]]
    footer: ClassVar[int | None] = None
    data_end: ClassVar[int | None] = None

    def __init__(self, file: FileBytes, findings: Findings, form: RecordFormat[Head]) -> None:
        self._file = file
        self._findings = findings
        self._form = form
        self._pieces: list[Piece] = []
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
            self._findings.lose(f'{file.name}: {error}; what follows is not read')
            ended = True
        if not ended and (self.footer is not None or self._cut_at is not None):
            place = '' if self._cut_at is None else f', in the record at {self._cut_at}'
            text = f'{file.name}: cut off at byte {file.size}{place}; {self._read} was read'
            self._findings.lose(text, 0 if self._read == 'every message' else None)
        channels = self._channels()
        left_out = {
            key: len(self._stamps.pop(key)) for key in self._stamps.keys() - channels.keys()
        }
        if self._refused is not None:
            text = f'{file.name}: {self._refused}; the messages of all others are left out'
            self._findings.lose(text, sum(left_out.values()))
        else:
            for channel_id, count in left_out.items():
                text = f'{self.noun} {channel_id} is not described; its messages are left out'
                self._findings.lose(f'{file.name}: {text}', count)
        return FileContents(channels, self._pieces, self._compressions, self._stamps)

    def _walk(self) -> bool:
        """Enter all records; return whether the file ends as its format says.

        Raises:
            LimitError: There are too many.
        """
        file, others = self._file, 0
        search = Search(file.limits, _NO_PIECE)
        for record in walk(self._form, file, self._form.start, file.size, self._lose_bytes, search):
            if record.opcode == self.footer and record.end <= file.size:
                self._check_end(record.end)
                self._end_run()
                return True
            if record.opcode != self._form.message:
                others += _COST_OF_CHUNK if record.opcode == self._form.chunk else 1
                file.limits.add_records(_NO_PIECE, others)
            self._enter(record)
        self._end_run()
        return False

    def _check_end(self, end: int) -> None:
        """Enter a loss if more than the closing magic bytes is behind the footer."""
        end += self._form.start
        if self._file.size > end:
            self._findings.lose(
                f'{self._file.name}: it ends at byte {end}, and what follows is not read; if files'
                f' were joined there, take them apart'
            )

    def _lose_bytes(self, start: int, end: int) -> None:
        self._findings.lose(f'{self._file.name}: bytes {start} to {end} are damaged')

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
        for head, body in piece_records(
            self._form, self._file, record.position, data, self._findings
        ):
            self._enter_record(head, body, run)
        run.end_in(self._pieces, self._file.limits)

    def _end_run(self) -> None:
        self._run.end_in(self._pieces, self._file.limits)
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
    """Unpack a piece as RecordFormat.unpack does, within the limits of its file.

    Raises:
        DamagedHeadError: The head of the chunk is damaged.
        ValueError: The chunk is damaged, or too large together with others.
    """
    file.limits.add_block(position, form.unpacked_size(data))
    return form.unpack(data)


def piece_records(
    form: RecordFormat[Head],
    file: FileBytes,
    position: int,
    data: Buffer,
    findings: Findings,
    cost: int | None = None,
) -> Iterator[tuple[Head, memoryview]]:
    """Yield the records of a piece, head and body; skip damaged bytes.

    Args:
        form: The format of the records.
        file: The file of the piece.
        position: Of its first byte.
        data: A chunk, or records outside of chunks.
        findings: Damage is entered there.
        cost: Number of messages lost if nothing of it can be read.
    """
    place = f'{file.name}: the chunk at byte {position} is damaged'
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
        findings.lose(f'{place} ({error})', cost)
        return

    def lose(start: int, stop: int) -> None:
        findings.lose(f'{place} (bytes {start} to {stop} of it)')

    if whole:
        search = Search(file.limits, position)
        try:
            for record in walk(form, HeldBytes(view), done, len(view), lose, search):
                if record.end <= len(view):
                    head, start, end = form.split_record(view, record.position)
                    yield head, view[start:end]
                else:
                    lose(record.position, len(view))
        except LimitError as error:
            findings.lose(f'{place} ({error})')
