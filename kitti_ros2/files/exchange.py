# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Two names of a file system change places at once (Linux's renameat2)."""

from __future__ import annotations

import ctypes
import errno
import os
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
# Of systems and file systems without it, such as NFS.
_NOT_THERE = (errno.ENOSYS, errno.EINVAL, errno.EOPNOTSUPP)


def exchange(one: Path, other: Path) -> bool:
    """Let two existing files or folders change places; return False where that cannot be done.

    Raises:
        OSError: The file system refuses.
    """
    function = _renameat2()
    if function is None:
        return False
    places = os.fsencode(one), os.fsencode(other)
    if function(_AT_FDCWD, places[0], _AT_FDCWD, places[1], _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NOT_THERE:
        return False
    raise OSError(code, os.strerror(code), str(other))


@lru_cache(maxsize=1)
def _renameat2() -> Any:  # noqa: ANN401 - a foreign function, or None
    return getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
