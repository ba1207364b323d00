# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How large compressed data may become: some are made to fill the memory of who reads them."""

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
        stored: Bytes of the file.
    """

    def __init__(self, stored: int) -> None:
        self._stored = stored
        self._sizes: dict[int, int] = {}
        self._size = 0
        self._counts: dict[int, int] = {}
        self._count = 0
        self._refused = ''

    def add_block(self, position: int, size: int) -> None:
        """Enter the size of a block before it is decompressed; the same position counts once.

        Raises:
            ValueError: The blocks so far are too large, or have too many records.
        """
        if self._refused:
            raise ValueError(self._refused)
        if position not in self._sizes:
            check_file(self._stored, self._size + size)
            self._sizes[position] = size
            self._size += size

    def add_records(self, position: int, count: int) -> None:
        """Enter the number of records in a block, of which more than before may be known.

        Raises:
            ValueError: The blocks so far have too many.
        """
        more = count - self._counts.get(position, 0)
        if more <= 0:
            return
        self._counts[position] = count
        self._count += more
        always = _RECORDS_ALWAYS * (_limit(_ALWAYS) // _ALWAYS)
        most = max(always, self._stored // _BYTES_PER_RECORD)
        if self._count > most:
            self._refused = (
                f'{format_bytes(self._stored)} that hold more than {most} records;'
                f' {LARGEST_BLOCK}=SIZE in the environment allows more'
            )
            raise ValueError(self._refused)

    def counted(self, position: int, records: Iterable[Record]) -> Iterator[Record]:
        """Yield the records of a block while they are within the limit.

        Raises:
            ValueError: The blocks so far have too many.
        """
        for count, record in enumerate(records):
            if count % _COUNTED == 0:
                self.add_records(position, count)
            yield record


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
