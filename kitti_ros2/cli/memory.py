# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How the commands treat memory: what is freed is kept, imports are not searched for garbage."""

from __future__ import annotations

import ctypes
import gc

# From glibc's malloc.h; other libraries have no mallopt, or ignore what they do not know.
_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_KEPT_BYTES = 128 << 20
_BLOCK_BYTES = 32 << 20


def keep_freed_memory() -> None:
    """Reuse freed blocks instead of returning them to the kernel.

    A block that was returned costs a page fault for each 4 kB when it is taken anew: a tenth of
    the time of decoding a drive's images.
    """
    mallopt = getattr(ctypes.CDLL(None), 'mallopt', None)
    if mallopt is not None:
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, _BLOCK_BYTES)


def keep_imports() -> None:
    """End what boundary.main began: imports make many objects and no garbage to look for."""
    gc.freeze()
    gc.enable()
