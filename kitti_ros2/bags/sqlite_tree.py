# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Large values of a rosbag2 database, found by the tree of their table and read in large blocks.

SQLite reads a value page by page, each by a request of its own, and copies it twice: three times
the work of reading the file. The format is that of sqlite_scan; the inner pages of a table's tree
begin with 5, then the number of cells (uint16 at 3), the page of the last child (uint32 at 8) and
the offset of each cell (uint16 from 12 on): the page of a child (uint32) and the greatest id in it
(varint).
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from typing import TYPE_CHECKING

import numpy as np

from ..files.scattered import PageScatter
from .pieces import MessageStart
from .sqlite_scan import LEAF, LEAF_HEAD, UINT16, UINT32, parse_varint

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from .pieces import FileBytes
    from .sqlite_scan import Pages, Row

    Links = npt.NDArray[np.uint32]

_INNER = 5
_INNER_HEAD = 12
_DEEPEST = 20
_KEPT = 16
_LINK = 4
_BLOCK = 2**20
_SKIMMED_BLOCK = 2**20
_START_BYTES = 2**10
_BLOB = 12  # the type of an empty one; each byte adds 2


class TableTree:
    """The rows of a table by id. One thread may use it.

    Args:
        file: The database, undamaged as far as SQLite has read it.
        pages: Its pages.
        root: The number of the table's first page, from 1.
    """

    def __init__(self, file: FileBytes, pages: Pages, root: int) -> None:
        self._file = file
        self._pages = pages
        self._root = root
        self._inner: dict[int, tuple[list[int], list[int]]] = {}
        page_size = pages.page_size
        self._scatter = PageScatter(page_size, pages.usable - _LINK, _BLOCK)
        self._buffer = np.empty((max(1, _SKIMMED_BLOCK // page_size), page_size), np.uint8)
        self._ahead = np.arange(1, max(self._scatter.most, len(self._buffer)) + 1)

    def blob(self, row_id: int, size: int) -> memoryview:
        """Read the last column of a row, a blob of a size in bytes.

        Raises:
            ValueError: The row is not there, or not such a row, or its pages are damaged.
            OSError: The disk refuses.
        """
        row, local, first = self._open(row_id, size)
        payload = np.empty(row.size, np.uint8)
        payload[: len(local)] = np.frombuffer(local, np.uint8)
        rest, each = payload[len(local) :], self._pages.usable - _LINK

        def read(position: int, count: int, done: int) -> Links | None:
            target = rest[done : done + count * each]
            return self._file.scatter(self._scatter, position, count, target)

        self._follow(first, len(rest), self._scatter.most, read)
        return payload[row.size - size :].data.toreadonly()

    def start(self, row_id: int, size: int) -> MessageStart | memoryview:
        """Read the last column of a row as blob does, but keep its first page or two only.

        Where pages are small, the whole blob is returned.
        """
        row, local, first = self._open(row_id, size)
        each = self._pages.usable - _LINK
        if each < _START_BYTES or len(local) == row.size:
            return self.blob(row_id, size)
        kept = bytearray(local[row.size - size :])

        def read(position: int, count: int, done: int) -> Links | None:
            block = self._buffer[:count]
            if self._file.read_into(position, block) < block.size:
                return None
            if not done:
                kept.extend(block[0, _LINK : _LINK + min(each, row.size - len(local))])
            return block[:, :_LINK].view('>u4')[:, 0]

        self._follow(first, row.size - len(local), len(self._buffer), read)
        found = MessageStart(kept)
        found.size = size
        return found

    def _open(self, row_id: int, size: int) -> tuple[Row, bytes, int]:
        """Return a row, the part of its payload in its own page, and the page where it goes on.

        Raises:
            ValueError: The row is not there, or does not end in a blob of the size.
        """
        try:
            row, page, start = self._find(row_id)
        except (struct.error, IndexError) as error:
            raise ValueError('its tree is damaged') from error
        if row.types[-1] != _BLOB + 2 * size or row.size > self._file.size:
            raise ValueError('it is another row')
        end = start + self._pages.local(row.size)
        first = UINT32.unpack_from(page, end)[0] if end < start + row.size else 0
        return row, page[start:end], first

    def _find(self, row_id: int) -> tuple[Row, bytes, int]:
        """Return a row, its page, and the offset of its payload in that.

        Raises:
            ValueError, IndexError, struct.error: It is not there, or a page is damaged.
        """
        number = self._root
        for _ in range(_DEEPEST):
            known = self._inner.get(number)
            if known is None:
                page = self._page(number)
                if page[0] == LEAF:
                    return self._in_leaf(page, number, row_id)
                known = _children(page)
                if len(self._inner) >= _KEPT:
                    self._inner.clear()
                self._inner[number] = known
            ids, children = known
            number = children[bisect_left(ids, row_id)]
        raise ValueError('its tree has no end')

    def _in_leaf(self, page: bytes, number: int, row_id: int) -> tuple[Row, bytes, int]:
        (count,) = UINT16.unpack_from(page, 3)
        starts = struct.unpack_from(f'>{count}H', page, LEAF_HEAD)

        def id_at(start: int) -> int:
            _, at = parse_varint(page, start)
            return parse_varint(page, at)[0]

        position = (number - 1) * self._pages.page_size
        row = self._pages.cell(page, starts[bisect_left(starts, row_id, key=id_at)], position)
        if row is None or row.row_id != row_id:
            raise ValueError('it is not in its page')
        return row, page, row.position - position

    def _page(self, number: int) -> bytes:
        size = self._pages.page_size
        page = self._file.read((number - 1) * size, size) if number > 1 else b''
        if len(page) < size:
            raise ValueError(f'its page {number} is missing')
        return page

    def _follow(
        self, number: int, size: int, most: int, read: Callable[[int, int, int], Links | None]
    ) -> None:
        """Read a chain of pages to its end.

        Args:
            number: The first page.
            size: Of what the chain holds, in bytes.
            most: Number of pages to read at once.
            read: Called with the position of a page in the file, the number of pages to read from
                there, and the bytes of the chain read before; returns what the pages begin with:
                the number of the next page of their chain. None if the file ends before.

        Raises:
            ValueError: The chain is damaged.
        """
        each = self._pages.usable - _LINK
        expected = most
        done = 0
        while done < size:
            # Chains mostly continue in the next page.
            count = min(expected, most, -(-(size - done) // each))
            position = (number - 1) * self._pages.page_size
            links = read(position, count, done) if position > 0 else None
            if links is None:
                raise ValueError(f'its page {number} is missing')
            ends = (links != self._ahead[:count] + number).nonzero()[0]
            run = int(ends[0]) + 1 if len(ends) else count
            done += run * each
            number = int(links[run - 1])
            expected = most if run == count else 2 * run
        if number:
            raise ValueError('its pages go on behind its end')


def _children(page: bytes) -> tuple[list[int], list[int]]:
    """Return the greatest id in each child but the last, and the pages of the children.

    Raises:
        ValueError, IndexError, struct.error: The page is damaged.
    """
    if page[0] != _INNER:
        raise ValueError('its tree is damaged')
    (count,) = UINT16.unpack_from(page, 3)
    ids, children = [], []
    for start in struct.unpack_from(f'>{count}H', page, _INNER_HEAD):
        children.append(UINT32.unpack_from(page, start)[0])
        ids.append(parse_varint(page, start + 4)[0])
    children.append(UINT32.unpack_from(page, 8)[0])
    return ids, children
