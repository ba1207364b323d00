# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writing gigabytes without filling the page cache.

A drive that stays in the cache pushes other files out of memory, and on many machines taking fresh
pages costs more than writing does. Recent kernels (Linux 6.14; ext4, XFS and Btrfs since) begin to
write at once and drop the pages when they are on the disk; others write as usual. Source:
pwritev2(2), RWF_DONTCACHE.
"""

from __future__ import annotations

import errno
import mmap
import os
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence

    Buffers: TypeAlias = Sequence[bytes | bytearray | memoryview]

_RWF_DONTCACHE = 0x80  # include/uapi/linux/fs.h; the module os has no name for it
_UNKNOWN_FLAG = {errno.EOPNOTSUPP, errno.EINVAL}
_UNCACHED_FROM = 64 * 2**10
"""Below, a write of its own to the disk costs more than the page."""


def write_uncached(file: int, buffers: Buffers, position: int) -> int:
    """Write buffers at a position, or a part of them; large ones without filling the page cache.

    The last page is left for the next call where it is not full: a page that was forgotten would
    be read again to be filled up.

    Args:
        file: Descriptor of a regular file.
        buffers: Flat bytes, at most IOV_MAX of them.
        position: Where the first byte goes.

    Returns:
        How many bytes were written, as os.pwritev.

    Raises:
        OSError: The disk refuses.
    """
    size = sum(map(len, buffers))
    if size < _UNCACHED_FROM:
        return os.pwritev(file, buffers, position)
    pages = without_end(buffers, (position + size) % mmap.PAGESIZE)
    try:
        return os.pwritev(file, pages, position, _RWF_DONTCACHE)
    except OSError as error:
        if error.errno not in _UNKNOWN_FLAG:
            raise
    return os.pwritev(file, buffers, position)


def without_start(buffers: Buffers, count: int) -> Buffers:
    """What follows the first bytes of buffers, so many."""
    for index, buffer in enumerate(buffers):
        if count < len(buffer):
            return [memoryview(buffer)[count:], *buffers[index + 1 :]]
        count -= len(buffer)
    return []


def without_end(buffers: Buffers, count: int) -> Buffers:
    """What precedes the last bytes of buffers, so many."""
    if not count:
        return buffers
    for index, buffer in reversed(list(enumerate(buffers))):
        if count < len(buffer):
            return [*buffers[:index], memoryview(buffer)[: len(buffer) - count]]
        count -= len(buffer)
    return []
