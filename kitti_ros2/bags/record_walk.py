# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Records that follow each other, and where they go on after bytes that are damaged.

MCAP and ROS 1 are built alike: records, some of which are chunks of more records. A record is
believed when its own lengths agree and what follows it looks like a record too; else the bytes
after it are searched for records. In a chunk that is not compressed these may be its messages, so a
damaged head costs nothing but itself.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterator
    from typing import TypeAlias

    Buffer: TypeAlias = bytes | memoryview

    class Source(Protocol):
        """Bytes by position."""

        def read(self, position: int, length: int) -> Buffer:
            """So many bytes, fewer at the end."""
            ...


_WINDOW = 2**20


class Record(NamedTuple):
    """Where a record is: its kind, the position of its head, the position after its body."""

    opcode: int
    position: int
    end: int


class Kind(Enum):
    """What stands at a position."""

    WHOLE = 'a record'
    CUT = 'a record that goes beyond the end'
    NONE = 'no record'


class RecordFormat(Protocol):
    """What records of a format look like.

    Attributes:
        chunk: The opcode of chunks.
        candidate: Matches where a record may begin, with a lookahead.
        longest: The most bytes that it looks at.
        row: How many records in a row are no accident.
    """

    chunk: int
    candidate: re.Pattern[bytes]
    longest: int
    row: int

    def look(self, source: Source, position: int, end: int) -> tuple[Kind, Record]:
        """What stands at a position, by its head and the lengths inside it."""
        ...

    def is_checked(self, opcode: int) -> bool:
        """Whether such a record has a second length inside that agrees with its own."""
        ...

    def inside(self, source: Source, position: int) -> int | None:
        """Where the records of a chunk begin, None where it is compressed."""
        ...


def walk(
    form: RecordFormat, source: Source, position: int, end: int, lose: Callable[[int, int], None]
) -> Iterator[Record]:
    """The records from a position on; damaged bytes are passed over.

    Records that go beyond the end are given as well. Such a chunk, if it is not compressed, is
    followed by the records in it.

    Args:
        form: Their format.
        source: The bytes.
        position: Where the first record begins.
        end: Where the last one ends.
        lose: Told from where to where bytes are damaged.
    """
    while position < end:
        kind, record = form.look(source, position, end)
        if kind is Kind.WHOLE and _is_believed(form, source, record, end):
            yield record
            position = record.end
            continue
        if kind is Kind.CUT and record.opcode == form.chunk:
            yield record
            inside = form.inside(source, position)
            position = end if inside is None else inside
            continue
        found = find_record(form, source, position + 1, end)
        if found is None and kind is Kind.CUT:
            yield record
            return
        lose(position, end if found is None else found)
        position = end if found is None else found


def find_record(form: RecordFormat, source: Source, position: int, end: int) -> int | None:
    """The first position from which on records follow each other, None where there is none."""
    while position < end:
        window = source.read(position, min(_WINDOW, end - position) + form.longest)
        if not bytes(window).strip(b'\0'):
            position += _WINDOW  # what a crash leaves of a file that was not yet filled
            continue
        for match in form.candidate.finditer(window):
            start = position + match.start()
            if start < end and _begins_row(form, source, start, end):
                return start
        position += _WINDOW
    return None


def _is_believed(form: RecordFormat, source: Source, record: Record, end: int) -> bool:
    if record.end == end or form.is_checked(record.opcode):
        return True
    if form.look(source, record.end, end)[0] is Kind.WHOLE:
        return True
    # Either what follows is damaged, or this one's length is and hides others. In a chunk there are
    # records of right, even in one that is compressed, but no chunks.
    found = find_record(form, source, record.position + 1, record.end)
    while found is not None and record.opcode == form.chunk:
        if form.look(source, found, end)[1].opcode == form.chunk:
            return False
        found = find_record(form, source, found + 1, record.end)
    return found is None


def _begins_row(form: RecordFormat, source: Source, position: int, end: int) -> bool:
    for number in range(form.row):
        kind, record = form.look(source, position, end)
        if kind is not Kind.WHOLE:
            is_last = number == form.row - 1 and (number > 0 or record.opcode == form.chunk)
            return kind is Kind.CUT and is_last
        if record.end == end:
            return True
        position = record.end
    return True
