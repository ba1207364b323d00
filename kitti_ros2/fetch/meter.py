# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of several transfers at a time, and of the extraction after them."""

from __future__ import annotations

from threading import Event, Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Progress = Callable[[int, int], None]


class CancelledError(Exception):
    """The download was cancelled; raised in the threads of the transfers."""


class Meter:
    """Bytes of all transfers.

    Args:
        sizes: The size of each archive by name, as far as it is known.
        progress: Called with the bytes done and the bytes of all.
    """

    def __init__(self, sizes: dict[str, int], progress: Progress) -> None:
        self.cancelled = Event()
        self._sizes = sizes
        self._progress = progress
        self._done = 0
        self._lock = Lock()

    def advance(self, name: str, count: int, size: int | None) -> None:
        """Count bytes of a transfer, and note the size of its archive.

        Raises:
            CancelledError: The download was cancelled.
        """
        if self.cancelled.is_set():
            raise CancelledError
        with self._lock:
            self._done += count
            if size is not None:
                self._sizes[name] = size
            self._progress(self._done, max(self._done, sum(self._sizes.values())))
