# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writing gigabytes without filling the page cache.

A drive that stays in the cache pushes other files out of memory, and on many machines taking fresh
pages costs more than writing does. Linux 6.16 on ext4, XFS and Btrfs begins to write at once and
drops the pages when they are on the disk; others write as usual. Source: pwritev2(2),
RWF_DONTCACHE; 6.14 knows the flag, but could drop pages that were still in use.
"""

from __future__ import annotations

import errno
import mmap
import os
import re
import sys
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence

    Buffers: TypeAlias = Sequence[bytes | bytearray | memoryview]

_RWF_DONTCACHE = 0x80  # include/uapi/linux/fs.h; the module os has no name for it
_SOUND_SINCE = (6, 16)
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
    if size < _UNCACHED_FROM or not _KERNEL_DROPS_PAGES:
        return os.pwritev(file, buffers, position)
    pages = without_end(buffers, (position + size) % mmap.PAGESIZE)
    try:
        return os.pwritev(file, pages, position, _RWF_DONTCACHE)
    except NotImplementedError:
        pass  # a Python built for an old glibc takes no flags
    except OSError as error:
        if error.errno not in _UNKNOWN_FLAG:
            raise
    return os.pwritev(file, buffers, position)


def kernel_drops_pages(platform: str, release: str) -> bool:
    """Whether a kernel (sys.platform, os.uname().release) can be trusted with the flag."""
    version = re.match(r'(\d+)\.(\d+)', release, re.ASCII)
    if platform != 'linux' or version is None:
        return False
    return (int(version[1]), int(version[2])) >= _SOUND_SINCE


_KERNEL_DROPS_PAGES = kernel_drops_pages(sys.platform, os.uname().release)


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
