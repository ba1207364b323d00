# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The record formats of MCAP and ROS 1 files, and a walk over records that skips damaged bytes."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator

    from .container_file import StoredMessage
    from .decompression import Buffer, Search


# A walk over consecutive records that resumes after damaged bytes.
#
# MCAP and ROS 1 have the same structure: records, some of which are chunks of more records. A
# record is accepted if its own lengths agree and a record follows it; else the bytes after it are
# searched for records. In an uncompressed chunk these may be its messages, so a damaged chunk head
# costs no messages.

if TYPE_CHECKING:

    class Source(Protocol):
        """Bytes by position."""

        def read(self, position: int, length: int) -> Buffer:
            """Return `length` bytes, fewer at the end."""
            ...


_WINDOW = 2**20

Head = TypeVar('Head')


class Record(NamedTuple):
    """The position of a record: its kind, the position of its head, the position after its body."""

    opcode: int
    position: int
    end: int


class Kind(Enum):
    """The kind of bytes at a position."""

    WHOLE = 'a record'
    CUT = 'a record that goes beyond the end'
    NONE = 'no record'


class DamagedHeadError(ValueError):
    """The head of a chunk is invalid."""

    def __init__(self) -> None:
        super().__init__('its head is damaged')


class RecordFormat(Protocol[Head]):
    """The properties of a record format, whose records have heads of a type.

    Attributes:
        start: The position of a file's first record.
        chunk: The opcode of chunks.
        message: The opcode of messages.
        longest_message_head: The most bytes of a message up to its data.
        candidate: Matches where a record may begin, with a lookahead.
        longest: The most bytes that candidate matches.
        row: Number of consecutive records that are taken as no coincidence.
    """

    start: int
    chunk: int
    message: int
    longest_message_head: int
    candidate: re.Pattern[bytes]
    longest: int
    row: int

    def classify(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """Classify the bytes at a position, by the record's head and the lengths inside it."""
        ...

    def is_checked(self, opcode: int) -> bool:
        """Return whether records of an opcode contain a second length, which must agree."""
        ...

    def inside(self, source: Source, position: int) -> int | None:
        """Return the position of a chunk's first record, None if the chunk is compressed."""
        ...

    def compression(self, record: Buffer) -> str:
        """Return the name of a chunk's compression.

        Raises:
            DamagedHeadError: The head of the chunk is damaged or truncated.
        """
        ...

    def unpacked_size(self, data: Buffer) -> int:
        """Return the most bytes that unpack makes of a chunk.

        Raises:
            ValueError: The head of the chunk is damaged.
        """
        ...

    def unpack(self, data: Buffer) -> tuple[Buffer, bool]:
        """Return the records of a chunk, and whether it is whole; the first ones if truncated.

        Raises:
            DamagedHeadError: The head of the chunk is damaged.
            ValueError: The chunk is damaged.
        """
        ...

    def split_record(self, view: Buffer, position: int) -> tuple[Head, int, int]:
        """Return a record's head, and the start and end of its body."""
        ...

    def split_records(self, view: Buffer) -> Iterator[tuple[Head, int, int]]:
        """Yield consecutive records as split_record does, up to the first damaged one."""
        ...

    def stored_message(self, head: Head, body: memoryview) -> StoredMessage | None:
        """Return the message that a record is, None for others."""
        ...


def walk(
    form: RecordFormat[Any],
    source: Source,
    position: int,
    end: int,
    lose: Callable[[int, int], None],
    search: Search,
) -> Iterator[Record]:
    """Yield the records from a position on; skip damaged bytes.

    Records that extend beyond the end are yielded as well. Such a chunk is followed by the records
    in it, if it is not compressed.

    Args:
        form: The format of the records.
        source: The bytes.
        position: Start of the first record.
        end: End of the last record.
        lose: Called with the start and end of damaged bytes.
        search: Limits the cost of a search for records.

    Raises:
        LimitError: It would cost more.
    """
    while position < end:
        kind, record = form.classify(source, position, end)
        if kind is Kind.WHOLE and _is_believed(form, source, record, end, search):
            yield record
            position = record.end
            continue
        if kind is Kind.CUT and record.opcode == form.chunk:
            yield record
            inside = form.inside(source, position)
            position = end if inside is None else inside
            continue
        following = find_record(form, source, position + 1, end, search)
        if following is None and kind is Kind.CUT:
            yield record
            return
        lose(position, end if following is None else following)
        position = end if following is None else following


def find_record(
    form: RecordFormat[Any], source: Source, position: int, end: int, search: Search
) -> int | None:
    """Return the first position from which records are consecutive, None if there is none.

    Raises:
        LimitError: The search would cost too much.
    """
    while position < end:
        window = source.read(position, min(_WINDOW, end - position) + form.longest)
        if bytes(window) == bytes(len(window)):
            position += _WINDOW  # zeros, as a crash leaves in a file that was not yet filled
            continue
        done = 0
        for match in form.candidate.finditer(window):
            start = position + match.start()
            search.spend(match.start() - done, attempts=1)
            done = match.start()
            if start < end and _begins_row(form, source, start, end):
                return start
        search.spend(len(window) - done)
        position += _WINDOW
    return None


def _is_believed(
    form: RecordFormat[Any], source: Source, record: Record, end: int, search: Search
) -> bool:
    if record.end == end or form.is_checked(record.opcode):
        return True
    if form.classify(source, record.end, end)[0] is Kind.WHOLE:
        return True
    # Either the following bytes are damaged, or the length of this record, which then hides others.
    # A chunk contains records, which may be found even in a compressed one, but no chunks.
    inner = find_record(form, source, record.position + 1, record.end, search)
    while inner is not None and record.opcode == form.chunk:
        if form.classify(source, inner, end)[1].opcode == form.chunk:
            return False
        inner = find_record(form, source, inner + 1, record.end, search)
    return inner is None


def _begins_row(form: RecordFormat[Any], source: Source, position: int, end: int) -> bool:
    for number in range(form.row):
        kind, record = form.classify(source, position, end)
        if kind is not Kind.WHOLE:
            is_last = number == form.row - 1 and (number > 0 or record.opcode == form.chunk)
            return kind is Kind.CUT and is_last
        if record.end == end:
            return True
        position = record.end
    return True
