# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a file of a bag may hold, by its size on the disk: some are made to fill the memory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, TypeVar

from ..model.errors import UsageError
from ..model.text import format_bytes, shown
from ..options.quantity_parsers import parse_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Record = TypeVar('Record')
LARGEST_BLOCK = 'KITTI_ROS2_LARGEST_BLOCK'
_ALWAYS = 64 * 10**6
_RATIO = 16
_FILE_ALWAYS = 10**9
_FILE_RATIO = 100
_RECORDS_ALWAYS = 2 * 10**5
_COUNTED = 1000
_BYTES_PER_RECORD = 10  # compressed; a stamp alone has 8
_DESCRIPTIONS_ALWAYS = 20_000
_BYTES_PER_DESCRIPTION = 60
_TEXTS_ALWAYS = 16 * 10**6
_TEXTS_RATIO = 4
_SEARCHED_ALWAYS = 32 * 10**6
_SEARCHED_RATIO = 32
_SEARCHED_STEP = 10**4
_LOOK = 100  # bytes that are searched in the time of one look at a place


class LimitError(ValueError):
    """A file holds more than one of its size may."""


def largest_block(stored: int) -> int:
    """Return the most bytes that a compressed block of so many bytes may have.

    Sensors' data shrink to a third, and blank images to a hundredth, but those are small.

    Raises:
        UsageError: The environment variable that sets it is no size.
    """
    return max(_limit(_ALWAYS), _RATIO * stored)


def check_block(stored: int, size: int) -> None:
    """Check the size of a block before compression.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, largest_block(stored))


def check_file(stored: int, size: int) -> None:
    """Check the size of a file that is compressed as a whole; it goes to the disk.

    Raises:
        ValueError: It is too large.
    """
    _check(stored, size, max(_limit(_FILE_ALWAYS), _FILE_RATIO * stored))


class FileLimits:
    """What all blocks of a file may become together: each alone may be within its limits.

    Args:
        stored: Bytes of the file, compressed if all of it is.
    """

    def __init__(self, stored: int) -> None:
        self._stored = stored
        self._sizes: dict[int, int] = {}
        self._size = 0
        self._counts: dict[int, int] = {}
        self._count = 0
        self._refused = ''
        self._searched: dict[int, int] = {}
        self._all_searched = 0

    @property
    def largest_part(self) -> int:
        """The most bytes of a part that is held in memory, such as an index or a message."""
        return largest_block(self._stored)

    def descriptions(self) -> DescriptionLimits:
        """Return limits of what describes topics and types, of which nothing is entered yet."""
        return DescriptionLimits(self._stored)

    @property
    def most_records(self) -> int:
        """The most records of all blocks."""
        return max(_times(_RECORDS_ALWAYS), self._stored // _BYTES_PER_RECORD)

    def add_block(self, position: int, size: int) -> None:
        """Enter the size of a block before it is decompressed; the same position counts once.

        Raises:
            ValueError: The blocks so far are too large, or have too many records.
        """
        if self._refused and position not in self._counts:
            raise LimitError(self._refused)
        if position not in self._sizes:
            check_file(self._stored, self._size + size)
            self._sizes[position] = size
            self._size += size

    def add_records(self, position: int, count: int) -> None:
        """Enter the number of records in a block, of which more than before may be known.

        Raises:
            LimitError: The blocks so far have too many.
        """
        more = count - self._counts.get(position, 0)
        if more <= 0:
            return
        if self._refused or self._count + more > self.most_records:
            what = f'hold more than {self.most_records} records'
            self._refused = _exceeded(self._stored, what)
            raise LimitError(self._refused)
        self._counts[position] = count
        self._count += more

    def add_searched(self, position: int, cost: int) -> None:
        """Enter what it has cost so far to search the damaged bytes of a block.

        Args:
            position: Of the block.
            cost: In bytes that are searched in that time; of all searches the largest counts.

        Raises:
            LimitError: The blocks so far cost too much.
        """
        more = cost - self._searched.get(position, 0)
        if more <= 0:
            return
        most = max(_times(_SEARCHED_ALWAYS), _SEARCHED_RATIO * self._stored)
        if self._all_searched + more > most:
            raise LimitError(_exceeded(self._stored, 'hold too many damaged bytes to search'))
        self._searched[position] = cost
        self._all_searched += more

    def counted(self, position: int, records: Iterable[Record]) -> Iterator[Record]:
        """Yield the records of a block while they are within the limit.

        Raises:
            LimitError: The blocks so far have too many.
        """
        for count, record in enumerate(records):
            if count % _COUNTED == 0:
                self.add_records(position, count)
            yield record


class Search:
    """A search of the damaged bytes of a block.

    Args:
        limits: Of the file.
        position: Of the block.
    """

    def __init__(self, limits: FileLimits, position: int) -> None:
        self._limits = limits
        self._position = position
        self._cost = self._entered = 0

    def spend(self, size: int, looks: int = 0) -> None:
        """Enter more bytes that are searched, and the looks at places where a record may begin.

        Raises:
            LimitError: The file has cost too much.
        """
        self._cost += size + looks * _LOOK
        if self._cost - self._entered >= _SEARCHED_STEP:
            self._entered = self._cost
            self._limits.add_searched(self._position, self._cost)


class DescriptionLimits:
    """How many topics and types a file may describe, and by how much text.

    Args:
        stored: Bytes of the file, compressed if all of it is.
    """

    def __init__(self, stored: int) -> None:
        self._stored = stored
        self._most = max(_times(_DESCRIPTIONS_ALWAYS), stored // _BYTES_PER_DESCRIPTION)
        self._longest = max(_times(_TEXTS_ALWAYS), _TEXTS_RATIO * stored)
        self._count = 0
        self._size = 0

    def add(self, size: int) -> None:
        """Enter one more before it is kept.

        Args:
            size: Of its texts, in bytes.

        Raises:
            LimitError: There are too many, or their texts are too long.
        """
        if self._count == self._most:
            what = f'describe more than {self._most} topics and types'
            raise LimitError(_exceeded(self._stored, what))
        if self._size + size > self._longest:
            what = f'describe topics and types by more than {format_bytes(self._longest)}'
            raise LimitError(_exceeded(self._stored, what))
        self._count += 1
        self._size += size


def _exceeded(stored: int, what: str) -> str:
    return (
        f'{format_bytes(stored)} that {what}; {LARGEST_BLOCK}=SIZE in the environment allows more'
    )


def _times(always: int) -> int:
    """Return what any file may have, more where a user has raised the size of a block."""
    return always * (_limit(_ALWAYS) // _ALWAYS)


def _check(stored: int, size: int, most: int) -> None:
    if size > most:
        raise ValueError(
            f'{format_bytes(stored)} that become {format_bytes(size)}; expected at most'
            f' {format_bytes(most)}; {LARGEST_BLOCK}=SIZE in the environment allows more'
        )


def _limit(default: int) -> int:
    text = os.environ.get(LARGEST_BLOCK)
    if not text:
        return default
    try:
        return max(parse_bytes(text), default)
    except ValueError:
        raise UsageError(f'{LARGEST_BLOCK} takes a size such as 2GB, not {shown(text)}') from None
