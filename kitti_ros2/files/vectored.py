# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An unbuffered file that passes lists of buffers to the kernel without a copy."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from .page_cache import without_start, write_uncached

if TYPE_CHECKING:
    from pathlib import Path

    from .page_cache import Buffers

_MAX_BUFFERS = min(os.sysconf('SC_IOV_MAX'), 1024)


class VectoredFile:
    """A new file, written from start to end.

    Attributes:
        position: Bytes written so far.

    Raises:
        OSError: The file exists or cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self.position = 0

    def write(self, buffers: Buffers) -> None:
        """Append all buffers (flat bytes) in order.

        Raises:
            OSError: The disk refuses; part of the buffers may have been written.
            ValueError: A buffer is not flat bytes.
        """
        for start in range(0, len(buffers), _MAX_BUFFERS):
            self._write_batch(buffers[start : start + _MAX_BUFFERS])

    def write_at(self, position: int, data: bytes) -> None:
        """Overwrite bytes that were written before.

        Raises:
            OSError: The disk refuses.
        """
        while data:
            written = os.pwrite(self._fd, data, position)
            position += written
            data = data[written:]

    def close(self) -> None:
        """Close the file; does nothing if it is closed.

        Raises:
            OSError: The file system reports a write that failed late.
        """
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _write_batch(self, buffers: Buffers) -> None:
        left = sum(map(len, buffers))
        while left > 0:
            written = write_uncached(self._fd, buffers, self.position)
            self.position += written
            left -= written
            if left > 0:
                # All but the last page; at most 2 GiB - 4 KiB; less where the disk fills up.
                buffers = without_start(buffers, written)
        if left:
            raise ValueError("a message part is no flat buffer of bytes (memoryview format 'B')")
