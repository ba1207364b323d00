# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that wait for stores; what they have not begun is dropped when the process ends."""

from __future__ import annotations

import os
from threading import Lock
from typing import TYPE_CHECKING

from .threads import Threads

if TYPE_CHECKING:
    from collections.abc import Callable

    from .threads import ThreadTask

THREADS = 16
"""Requests at the same time; they wait, most of the time."""


class BackgroundReads:
    """Threads that read; they are never closed."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._threads = Threads(THREADS, 'read')

    def submit(self, read: Callable[[], bytes]) -> ThreadTask[bytes]:
        """Read when a thread is free; cancel the task if it is not needed any more."""
        with self._lock:
            if self._process != os.getpid():  # threads are not forked
                self._process, self._threads = os.getpid(), Threads(THREADS, 'read')
            return self._threads.submit(read)


BACKGROUND = BackgroundReads()
