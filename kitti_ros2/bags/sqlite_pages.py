# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The rows of a rosbag2 database from its pages, without SQLite, for truncated or damaged files."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

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
    """A row of a table: its id, the types of its columns, and the position of its payload.

    Attributes:
        row_id: The id.
        types: Types of the columns, as SQLite numbers them.
        values: Offset of the first value in the payload.
        size: Bytes of the payload.
        position: Offset of the payload in the file.
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
        page_size, usable: Bytes of a page, and those that the format uses.

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
        remaining = self._file.size
        # Pages that are made so have a cell for every two bytes.
        for row in self._file.limits.counted(0, self._cells()):
            if row is not None and row.size <= remaining:
                remaining -= row.size
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
        remaining = row.size - local
        link = self._file.read(row.position + local, 4) if remaining else bytes(4)
        if len(parts[0]) < local or len(link) < 4:
            raise ValueError('its page is missing')
        while remaining:
            page = self._page(*UINT32.unpack(link))
            parts.append(page[4 : min(self.usable, remaining + 4)])
            remaining -= len(parts[-1])
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
            head, offset = parse_varint(page, at)
            types: list[int] = []
            if head > _LONGEST_HEAD:
                return None
            while offset < at + head:
                kind, offset = parse_varint(page, offset)
                types.append(kind)
        except IndexError:
            return None
        sound = offset == at + head and end <= len(page) and head <= size and types
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
    for offset in range(at, at + 8):
        value = value << 7 | data[offset] & 0x7F
        if data[offset] < 0x80:
            return value, offset + 1
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
