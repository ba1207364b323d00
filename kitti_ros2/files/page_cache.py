# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes that do not fill the page cache.

A drive that stays in the cache evicts other files from memory, and on many machines allocating
pages costs more than writing does. Linux 6.16 on ext4, XFS and Btrfs starts writeback at once and
drops the pages when they are on the disk; other systems keep the pages, and older Linux starts
writeback at once all the same, so that a later fsync has little to do. Source: pwritev2(2),
RWF_DONTCACHE; 6.14 supports the flag, but could drop pages that were still in use.
"""

from __future__ import annotations

import errno
import mmap
import os
import re
import sys
from typing import TYPE_CHECKING, TypeAlias

from .durability import start_writing_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    Buffers: TypeAlias = Sequence[bytes | bytearray | memoryview]

_RWF_DONTCACHE = 0x80  # include/uapi/linux/fs.h; missing in the module os
_SOUND_SINCE = (6, 16)
_UNKNOWN_FLAG = {errno.EOPNOTSUPP, errno.EINVAL}
_UNCACHED_FROM = 64 * 2**10
"""Below this size in bytes, a separate write to the disk costs more than the page."""


def write_uncached(file: int, buffers: Buffers, position: int) -> int:
    """Write all or part of the buffers at a position; large ones without filling the page cache.

    A last page that is not full is left to the next call: once dropped, it would have to be read
    again to be filled up.

    Args:
        file: Descriptor of a regular file.
        buffers: Flat bytes, at most IOV_MAX of them.
        position: Of the first byte in the file.

    Returns:
        Number of bytes written, as os.pwritev.

    Raises:
        OSError: The disk refuses.
    """
    size = sum(map(len, buffers))
    if size < _UNCACHED_FROM:
        return os.pwritev(file, buffers, position)
    if not _KERNEL_DROPS_PAGES:
        return _write_cached(file, buffers, position)
    pages = without_end(buffers, (position + size) % mmap.PAGESIZE)
    try:
        return os.pwritev(file, pages, position, _RWF_DONTCACHE)
    except NotImplementedError:
        pass  # a Python built for an old glibc supports no flags
    except OSError as error:
        if error.errno not in _UNKNOWN_FLAG:
            raise
    return _write_cached(file, buffers, position)


def _write_cached(file: int, buffers: Buffers, position: int) -> int:
    written = os.pwritev(file, buffers, position)
    start_writing_out(file, position, written)
    return written


def kernel_drops_pages(platform: str, release: str) -> bool:
    """Whether a kernel (sys.platform, os.uname().release) handles the flag correctly."""
    version = re.match(r'(\d+)\.(\d+)', release, re.ASCII)
    if platform != 'linux' or version is None:
        return False
    return (int(version[1]), int(version[2])) >= _SOUND_SINCE


_KERNEL_DROPS_PAGES = kernel_drops_pages(sys.platform, os.uname().release)


def without_start(buffers: Buffers, count: int) -> Buffers:
    """Return the buffers without their first `count` bytes."""
    for index, buffer in enumerate(buffers):
        if count < len(buffer):
            return [memoryview(buffer)[count:], *buffers[index + 1 :]]
        count -= len(buffer)
    return []


def without_end(buffers: Buffers, count: int) -> Buffers:
    """Return the buffers without their last `count` bytes."""
    if not count:
        return buffers
    for index, buffer in reversed(list(enumerate(buffers))):
        if count < len(buffer):
            return [*buffers[:index], memoryview(buffer)[: len(buffer) - count]]
        count -= len(buffer)
    return []
