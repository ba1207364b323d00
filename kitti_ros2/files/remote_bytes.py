# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of a file in a store by position: read ahead, neighbouring ranges in one request."""

from __future__ import annotations

import errno
import io
import os
from collections import OrderedDict
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ..model.errors import RemoteError
from .background_reads import BACKGROUND
from .remote_listing import sized_entry_of
from .remote_requests import fetch_range

if TYPE_CHECKING:
    from .threads import ThreadTask
    from .url_path import UrlPath

_BLOCK = 1 << 16
_MOST_REQUEST = 4 << 20
"""Longer ranges are read by several requests at the same time."""
_MOST_BYTES = 96 << 20
"""Kept of all files."""
_MOST_AHEAD = 16 << 20
_FIRST_AHEAD = 1 << 20
_NEAR = 1 << 17
"""A read so far behind the last one's end follows it."""
_TAIL = 1 << 18
"""Read of the end of a file when it is opened: most summaries of bags fit in."""


class _Range(NamedTuple):
    """Blocks of a file that one request reads.

    Attributes:
        start: Of the first block, in bytes.
        data: The bytes, once they are there.
        length: Their number.
    """

    start: int
    data: ThreadTask[bytes]
    length: int


_Version: TypeAlias = 'tuple[UrlPath, int, int]'
"""A file with its size in bytes and the time of its change."""


class _Blocks:
    """The blocks of all files that are being read, the last used ones."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._of: dict[tuple[_Version, int], _Range] = {}
        self._ranges: OrderedDict[tuple[_Version, int], _Range] = OrderedDict()
        self._held = 0

    def want(self, file: _Version, start: int, end: int) -> list[_Range]:
        """Return the ranges with the bytes from start to end; what is missing is requested."""
        with self._lock:
            if self._process != os.getpid():
                self._process, self._held = os.getpid(), 0
                self._of.clear()
                self._ranges.clear()
            found: list[_Range] = []
            first = block = start // _BLOCK
            last = -(-end // _BLOCK)
            while block < last:
                known = self._of.get((file, block))
                if known is not None and known.data.has_failed():
                    self._drop((file, known.start // _BLOCK))
                    known = None
                if known is None:
                    first, most = block, block + _MOST_REQUEST // _BLOCK
                    while block < min(last, most) and (file, block) not in self._of:
                        block += 1
                    known = self._request(file, first, block)
                self._ranges.move_to_end((file, known.start // _BLOCK))
                found.append(known)
                block = (known.start + known.length - 1) // _BLOCK + 1
            self._shrink(len(found))
            return found

    def _request(self, file: _Version, first: int, end: int) -> _Range:
        start, stop = first * _BLOCK, min(end * _BLOCK, file[1])
        data = BACKGROUND.submit(partial(_fetch, *file[:2], start, stop))
        made = _Range(start, data, stop - start)
        self._ranges[file, first] = made
        self._held += made.length
        for block in range(first, end):
            self._of[file, block] = made
        return made

    def _shrink(self, needed: int) -> None:
        """Drop the ranges that were not used for longest."""
        while self._held > _MOST_BYTES and len(self._ranges) > needed:
            self._drop(next(iter(self._ranges)))

    def _drop(self, key: tuple[_Version, int]) -> None:
        file, first = key
        gone = self._ranges.pop(key)
        gone.data.cancel()
        self._held -= gone.length
        for block in range(first, (gone.start + gone.length - 1) // _BLOCK + 1):
            del self._of[file, block]


_BLOCKS = _Blocks()


def _fetch(path: UrlPath, size: int, start: int, end: int) -> bytes:
    data = fetch_range(path, start, end)
    if len(data) == end - start:
        return data
    if len(data) == size <= _MOST_REQUEST:
        return data[start:end]
    raise RemoteError(
        path,
        'the server sends whole files only, not the requested part',
        'use a server that supports ranges, or download the file',
    )


class RemoteBytes:
    """A file of a store, by position.

    Attributes:
        size: In bytes, when it was opened.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    def __init__(self, path: UrlPath) -> None:
        entry = sized_entry_of(path)
        if entry.is_folder:
            raise IsADirectoryError(errno.EISDIR, 'Is a directory', str(path))
        if entry.size is None:
            raise RemoteError(path, 'the server does not say how long the file is', 'download it')
        self.size = entry.size
        self._file = path, entry.size, entry.changed_ns
        self._last_end = -1
        self._ahead = 0

    def read(self, position: int, length: int) -> bytes:
        """Read `length` bytes, fewer at the end of the file, none outside of it.

        Raises:
            OSError, RemoteError: The store refuses.
        """
        end = min(position + length, self.size)
        if length <= 0 or not 0 <= position < end:
            return b''
        if self._last_end < 0 and position == 0:
            self.expect(max(self.size - _TAIL, 0), _TAIL)
        ranges = _BLOCKS.want(self._file, position, end)
        self._read_ahead(position, end)
        pieces = []
        for each in ranges:
            data, at = each.data.result(), each.start
            pieces.append(data[max(position - at, 0) : end - at])
        return pieces[0] if len(pieces) == 1 else b''.join(pieces)

    def _read_ahead(self, position: int, end: int) -> None:
        """Request what follows, more and more of it, while the file is read in order."""
        if 0 <= position - self._last_end + _BLOCK <= _NEAR + _BLOCK:
            self._ahead = min(max(2 * self._ahead, _FIRST_AHEAD), _MOST_AHEAD)
            self.expect(end, self._ahead)
        elif position != self._last_end:
            self._ahead = 0
        self._last_end = end

    def expect(self, position: int, length: int) -> None:
        """Request bytes that will be read."""
        end = min(position + length, self.size)
        if 0 <= position < end:
            _BLOCKS.want(self._file, position, end)


class RemoteFile(io.RawIOBase):
    """A file of a store opened for reading.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """

    def __init__(self, path: UrlPath) -> None:
        super().__init__()
        self._bytes = RemoteBytes(path)
        self._position = 0
        self.name = str(path)

    def readable(self) -> bool:
        """Return true."""
        return True

    def seekable(self) -> bool:
        """Return true."""
        return True

    def tell(self) -> int:
        """Return the position."""
        return self._position

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """Move to a position."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._bytes.size}
        self._position = max(base[whence] + offset, 0)
        return self._position

    def readinto(self, target: bytearray | memoryview, /) -> int:  # type: ignore[override]
        """Read into a buffer."""
        view = memoryview(target).cast('B')
        data = self._bytes.read(self._position, len(view))
        view[: len(data)] = data
        self._position += len(data)
        return len(data)
