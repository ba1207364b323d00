# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of a database by number, the next ones read by a thread while they are read in order."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..files.background_reads import BACKGROUND
from ..files.workers import worker_count

if TYPE_CHECKING:
    from concurrent.futures import Future

    import numpy.typing as npt

    from .pieces import FileBytes

_BLOCK = 2**20
_NEAR = 8
"""Pages of other trees between two chains that were written one after the other."""


class _Block(NamedTuple):
    first: int
    pages: npt.NDArray[np.uint8]


class PagesAhead:
    """The pages of a file. One thread may use it.

    Args:
        file: The file.
        page_size: In bytes.
    """

    def __init__(self, file: FileBytes, page_size: int) -> None:
        self._file = file
        self._size = page_size
        self.most = max(1, _BLOCK // page_size)
        self._buffers = [np.empty((self.most, page_size), np.uint8) for _ in range(2)]
        self._held = _Block(0, self._buffers[0][:0])
        self._coming: tuple[_Block, Future[int]] | None = None
        self._reads_ahead = worker_count() > 1
        self._next = 0

    def page(self, number: int) -> bytes:
        """Read a page.

        Raises:
            ValueError: The file does not hold it.
            OSError: The disk refuses.
        """
        at = number - self._held.first
        if 0 <= at < len(self._held.pages):
            return bytes(self._held.pages[at].data)
        page = self._file.read((number - 1) * self._size, self._size) if number > 1 else b''
        if len(page) < self._size:
            raise ValueError(f'its page {number} is missing')
        return page

    def read(self, number: int, count: int) -> npt.NDArray[np.uint8]:
        """Read one to `count` pages, (N, page size), valid until the next call.

        Args:
            number: Of the first.
            count: At most `most`.

        Raises:
            ValueError: The file does not hold them.
            OSError: The disk refuses.
        """
        in_order = 0 <= number - self._next <= _NEAR
        if not self._holds(number):
            self._held = self._taken(number) or self._now(number, count)
            if in_order and self._reads_ahead and self._coming is None:
                self._begin(self._held.first + len(self._held.pages))
        pages = self._held.pages[number - self._held.first :][:count]
        self._next = number + len(pages)
        return pages

    def _holds(self, number: int) -> bool:
        return 0 <= number - self._held.first < len(self._held.pages)

    def _taken(self, number: int) -> _Block | None:
        """Return what the thread has read if that holds a page; else it is of no interest."""
        if self._coming is None:
            return None
        (first, pages), future = self._coming
        self._coming = None
        if future.exception():  # which is raised again if the page is needed
            return None
        count = future.result() // self._size
        return _Block(first, pages[:count]) if 0 <= number - first < count else None

    def _now(self, number: int, count: int) -> _Block:
        block = self._spare()[:count]
        if number <= 1 or self._file.read_into((number - 1) * self._size, block) < block.nbytes:
            raise ValueError(f'its page {number} is missing')
        return _Block(number, block)

    def _begin(self, number: int) -> None:
        """Read the next block in the background, into the buffer that is not in use."""
        block, position = self._spare(), (number - 1) * self._size
        if position < self._file.size:
            future = BACKGROUND.submit(lambda: self._file.read_into(position, block))
            self._coming = _Block(number, block), future

    def _spare(self) -> npt.NDArray[np.uint8]:
        return self._buffers[self._held.pages.base is self._buffers[0]]
