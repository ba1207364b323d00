# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 database read from its pages, without SQLite: damaged ones, and large values."""

from __future__ import annotations

import struct
from bisect import bisect_left
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .container_file import MessageStart, PageScatter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from .container_file import FileBytes


# The rows of a rosbag2 database from its pages, for truncated or damaged files.
#
# https://sqlite.org/fileformat2.html, big endian. A file consists of pages of one size. Rows are in
# the leaves of trees, pages that begin with 13 (the first page after a head of 100 bytes): the
# number of cells (uint16 at 3) and the offset of each in the page (uint16 from 8 on). A cell is the
# size of its payload and the row's id (varints) and the payload, which may continue in a chain of
# overflow pages: each the number of the next (uint32) and bytes. A payload is the size of its head,
# the types of its columns (all varints) and their values. Nothing here needs the trees' inner
# pages.


_MAGIC = b'SQLite format 3\0'
_HEAD_SIZE = 100
LEAF = 13
_LONGEST_HEAD = 100  # of a row: rosbag2 has tables of up to six columns
LEAF_HEAD = 8
_BLOCK = 2**20
UINT16 = struct.Struct('>H')
UINT32 = struct.Struct('>I')
# By type the bytes of an integer, and the value of types without bytes.
_INTEGERS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
_CONSTANTS = {8: 0, 9: 1}


class Row(NamedTuple):
    """A row of a table: its id, the types of its columns, and the place of its payload.

    Attributes:
        row_id: The id.
        types: Of the columns, as SQLite numbers them.
        values: Offset of the first value in the payload.
        size: Of the payload, in bytes.
        position: Of the payload in the file.
    """

    row_id: int
    types: tuple[int, ...]
    values: int
    size: int
    position: int


class MessageRow(NamedTuple):
    """A message without its data."""

    row: Row
    topic_id: int
    stamp_ns: int


class Pages:
    """The whole pages of a database.

    Attributes:
        expected: The file's size according to its head, in bytes; 0 if that is unreliable.
        page_size, usable: Of a page, in bytes: all of it, and what the format uses.

    Raises:
        ValueError: The head is invalid.
    """

    def __init__(self, file: FileBytes) -> None:
        self._file = file
        head = file.read(0, _HEAD_SIZE)
        if len(head) < _HEAD_SIZE or not head.startswith(_MAGIC):
            raise ValueError('it does not begin as one')
        (size,) = UINT16.unpack_from(head, 16)
        self.page_size = 2**16 if size == 1 else size
        if self.page_size < 512 or self.page_size & (self.page_size - 1):
            raise ValueError(f'pages of {size} bytes')
        self.usable = self.page_size - head[20]
        # The number of pages is valid if two change counters agree.
        counted = head[24:28] == head[92:96]
        self.expected = UINT32.unpack_from(head, 28)[0] * self.page_size if counted else 0
        self._block_at, self._block = 0, b''

    def rows(self) -> Iterator[Row]:
        """Yield the rows of all tables, by page; those that the file has no bytes for are not.

        Pages may lead to each other in a circle, which has data of any size.
        """
        left = self._file.size
        # Pages that are made so have a cell for every two bytes.
        for row in self._file.limits.counted(0, self._cells()):
            if row is not None and row.size <= left:
                left -= row.size
                yield row

    def _cells(self) -> Iterator[Row | None]:
        pages = max(1, _BLOCK // self.page_size)
        for start in range(0, self._file.size, pages * self.page_size):
            block = self._file.read(start, pages * self.page_size)
            first = np.frombuffer(block, np.uint8)[:: self.page_size]
            numbers = np.flatnonzero(first == LEAF).tolist()
            if start == 0 and block[_HEAD_SIZE : _HEAD_SIZE + 1] == bytes((LEAF,)):
                numbers.insert(0, 0)
            for number in numbers:
                at = number * self.page_size
                page = block[at : at + self.page_size]
                if len(page) == self.page_size:
                    yield from self._leaf(page, start + at)

    def messages(self) -> Iterator[MessageRow]:
        """Yield the rows that are messages: an id, two integers and a blob."""
        for row in self.rows():
            types = row.types
            if len(types) == 4 and types[0] == 0 and types[3] >= 12 and types[3] % 2 == 0:
                start = row.position + row.values
                body = self._file.read(start, 16)
                topic_id, used = _integer(types[1], body)
                stamp_ns, _ = _integer(types[2], body[used:])
                if topic_id is not None and stamp_ns is not None:
                    yield MessageRow(row, topic_id, stamp_ns)

    def texts(self) -> Iterator[tuple[int, list[str]]]:
        """Yield id and columns of the rows that consist of an id and texts."""
        for row in self.rows():
            if row.types[0] == 0 and all(kind >= 13 and kind % 2 for kind in row.types[1:]):
                try:
                    payload = self.payload(row)[row.values :]
                except ValueError:
                    continue
                texts = []
                for kind in row.types[1:]:
                    size = (kind - 13) // 2
                    texts.append(payload[:size].decode(errors='replace'))
                    payload = payload[size:]
                yield row.row_id, texts

    def data(self, message: MessageRow) -> bytes:
        """Read the data of a message: the last column of its row.

        Raises:
            ValueError: The data are damaged or incomplete.
        """
        return self.payload(message.row)[-((message.row.types[3] - 12) // 2) :]

    def payload(self, row: Row) -> bytes:
        """Read the payload of a row.

        Raises:
            ValueError: The payload is damaged or incomplete.
        """
        local = self.local(row.size)
        parts = [self._file.read(row.position, local)]
        left = row.size - local
        link = self._file.read(row.position + local, 4) if left else bytes(4)
        if len(parts[0]) < local or len(link) < 4:
            raise ValueError('its page is missing')
        while left:
            page = self._page(*UINT32.unpack(link))
            parts.append(page[4 : min(self.usable, left + 4)])
            left -= len(parts[-1])
            link = page[:4]
        if link != bytes(4):
            raise ValueError('its pages go on behind its end')
        return b''.join(parts)

    def local(self, size: int) -> int:
        """Return the number of bytes of a payload that are in the leaf."""
        usable = self.usable
        if size <= usable - 35:
            return size
        least = (usable - 12) * 32 // 255 - 23
        local = least + (size - least) % (usable - 4)
        return local if local <= usable - 35 else least

    def _page(self, number: int) -> bytes:
        at = (number - 1) * self.page_size
        if not self._block_at <= at <= self._block_at + len(self._block) - self.page_size:
            # Chains mostly continue in the next page.
            self._block_at = at
            self._block = self._file.read(at, max(_BLOCK, self.page_size)) if number > 1 else b''
        start = at - self._block_at
        page = self._block[start : start + self.page_size]
        if len(page) < self.page_size:
            raise ValueError(f'its page {number} is missing')
        return page

    def _leaf(self, page: bytes, position: int) -> Iterator[Row | None]:
        head = _HEAD_SIZE if position == 0 else 0
        (cells,) = UINT16.unpack_from(page, head + 3)
        first = head + LEAF_HEAD
        if first + 2 * cells > len(page):
            return
        for (start,) in UINT16.iter_unpack(page[first : first + 2 * cells]):
            yield self.cell(page, start, position) if start >= first + 2 * cells else None

    def cell(self, page: bytes, start: int, position: int) -> Row | None:
        """Parse the row at an offset in a page, None if it is invalid."""
        try:
            size, at = parse_varint(page, start)
            row_id, at = parse_varint(page, at)
            end = at + self.local(size)
            head, place = parse_varint(page, at)
            types: list[int] = []
            if head > _LONGEST_HEAD:
                return None
            while place < at + head:
                kind, place = parse_varint(page, place)
                types.append(kind)
        except IndexError:
            return None
        sound = place == at + head and end <= len(page) and head <= size and types
        if not sound or head + sum(map(_width, types)) != size:
            return None
        signed = row_id - 2**64 if row_id >= 2**63 else row_id
        return Row(signed, tuple(types), head, size, position + at)


def parse_varint(data: bytes, at: int) -> tuple[int, int]:
    """Parse a number; return it and the offset after it.

    Raises:
        IndexError: The data are truncated.
    """
    value = 0
    for place in range(at, at + 8):
        value = value << 7 | data[place] & 0x7F
        if data[place] < 0x80:
            return value, place + 1
    return value << 8 | data[at + 8], at + 9


def _width(kind: int) -> int:
    """Return the size of a value in bytes."""
    if kind >= 12:
        return (kind - 12) // 2
    return 8 if kind == 7 else _INTEGERS.get(kind, 0)


def _integer(kind: int, data: bytes) -> tuple[int | None, int]:
    """Return the integer at the start of data, None for other types, and its size in bytes."""
    size = _width(kind)
    if kind in _INTEGERS:
        return int.from_bytes(data[:size], 'big', signed=True), size
    return _CONSTANTS.get(kind), size


# Large values of a rosbag2 database, found by the tree of their table and read in large blocks.
#
# SQLite reads a value page by page, each by a request of its own, and copies it twice: three times
# the work of reading the file. The format is that of sqlite_scan; the inner pages of a table's tree
# begin with 5, then the number of cells (uint16 at 3), the page of the last child (uint32 at 8) and
# the offset of each cell (uint16 from 12 on): the page of a child (uint32) and the greatest id in
# it (varint).


if TYPE_CHECKING:
    Links = npt.NDArray[np.uint32]

_INNER = 5
_INNER_HEAD = 12
_DEEPEST = 20
_KEPT = 16
_LINK = 4
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
