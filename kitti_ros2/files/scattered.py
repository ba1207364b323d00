# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pages of a file read so that the start of each goes to one place and the rest to another.

The kernel puts the bytes where they belong (preadv(2)). Reading the pages first and copying them
afterwards takes half as long again, and an object for each part, as os.preadv wants it, longer.
"""

from __future__ import annotations

import ctypes
import errno
import os
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Bytes = np.ndarray[tuple[int], np.dtype[np.uint8]]

_IOV_MAX = min(os.sysconf('SC_IOV_MAX'), 1024)
_IOVEC = np.dtype([('address', np.uintp), ('size', np.uintp)])  # sys/uio.h
_HEAD = 4


class PageScatter:
    """Reads pages of one size: heads of 4 bytes, bodies, and a rest of each that nobody needs.

    One thread may use it.

    Args:
        page_size: In bytes.
        body_size: Of the body that follows the head, in bytes.
        block_size: Pages of about so many bytes are read at once.

    Attributes:
        most: Number of pages that are read at once.
    """

    def __init__(self, page_size: int, body_size: int, block_size: int) -> None:
        rest_size = page_size - _HEAD - body_size
        sizes = [_HEAD, body_size, rest_size] if rest_size else [_HEAD, body_size]
        self.most = max(1, min(block_size // page_size, _IOV_MAX // len(sizes)))
        self._page_size = page_size
        self._body_size = body_size
        self._heads = np.zeros(self.most, '>u4')
        self._rest = np.empty(page_size, np.uint8)
        self._parts = np.zeros((self.most, len(sizes)), _IOVEC)
        self._parts['size'] = self._of_page = np.array(sizes, np.uintp)
        self._sizes, addresses = self._parts['size'], self._parts['address']
        numbers = np.arange(self.most, dtype=np.uintp)
        addresses[:, 0] = numbers * np.uintp(_HEAD) + np.uintp(_address(self._heads))
        addresses[:, 2:] = _address(self._rest)
        self._bodies = addresses[:, 1]
        self._places = numbers * np.uintp(body_size)

    def read(
        self, file: int, position: int, count: int, target: Bytes
    ) -> npt.NDArray[np.uint32] | None:
        """Read pages that follow each other.

        Args:
            file: Descriptor.
            position: Of the first page, in bytes.
            count: Number of pages, at most `most`.
            target: (N,) contiguous uint8, gets their bodies; it ends in the body of the last page.

        Returns:
            Their heads, (count,) big-endian uint32, valid until the next call; None if the file
            ends before.

        Raises:
            OSError: The disk refuses.
            ValueError: The target does not end in the body of the last page.
            TypeError: It is not contiguous, or read-only.
        """
        last = len(target) - (count - 1) * self._body_size
        if not (0 < count <= self.most and 0 < last <= self._body_size and target.itemsize == 1):
            raise ValueError(f'{count} pages do not fit {len(target)} bytes')
        np.add(self._places[:count], np.uintp(_address(target)), out=self._bodies[:count])
        sizes = self._sizes[count - 1]
        sizes[1], sizes[2:] = last, 0
        try:
            done = _fill(file, self._parts[:count], position)
        finally:
            sizes[:] = self._of_page
        wanted = (count - 1) * self._page_size + _HEAD + last
        return self._heads[:count] if done == wanted else None


def _address(array: npt.NDArray[Any]) -> int:
    """Return the address of a contiguous array that may be written."""
    return ctypes.addressof(ctypes.c_char.from_buffer(array.data))


def _fill(file: int, parts: npt.NDArray[np.void], position: int) -> int:
    """Read into places of memory; return the number of bytes, fewer at the end of the file."""
    function = _preadv()
    if function is None:
        return _copy(file, parts, position)
    while (count := int(function(file, _address(parts), parts.size, position))) < 0:
        code = ctypes.get_errno()
        if code != errno.EINTR:
            raise OSError(code, os.strerror(code))
    return count


def _copy(file: int, parts: npt.NDArray[np.void], position: int) -> int:
    """Read as _fill where the system has no preadv."""
    data = os.pread(file, int(parts['size'].sum()), position)
    done = 0
    for address, size in parts.ravel().tolist():
        part = data[done : done + size]
        ctypes.memmove(address, part, len(part))
        done += len(part)
    return done


@lru_cache(maxsize=1)
def _preadv() -> Any:  # noqa: ANN401 - a foreign function, or None
    library = ctypes.CDLL(None, use_errno=True)
    # glibc's preadv takes 32 bits of position on 32-bit systems; others have one name only.
    function = getattr(library, 'preadv64', None) or getattr(library, 'preadv', None)
    if function is not None:
        function.argtypes = ctypes.c_int, ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
        function.restype = ctypes.c_ssize_t
    return function
