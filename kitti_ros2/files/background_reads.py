# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that wait for stores; what they have not begun is dropped when the process ends."""

from __future__ import annotations

import os
from concurrent.futures import Future
from queue import SimpleQueue
from threading import Lock, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

THREADS = 16
"""Requests at the same time; they wait, most of the time."""


class BackgroundReads:
    """Daemon threads that read; those of a pool would read all that is pending before an exit."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process = 0
        self._threads = 0
        self._tasks: SimpleQueue[tuple[Future[bytes], Callable[[], bytes]]] = SimpleQueue()

    def submit(self, read: Callable[[], bytes]) -> Future[bytes]:
        """Read when a thread is free; cancel the future if it is not needed any more."""
        future: Future[bytes] = Future()
        with self._lock:
            if self._process != os.getpid():  # threads are not forked
                self._process, self._threads, self._tasks = os.getpid(), 0, SimpleQueue()
            self._tasks.put((future, read))
            if self._threads < THREADS:
                self._threads += 1
                Thread(target=self._run, args=(self._tasks,), daemon=True).start()
        return future

    @staticmethod
    def _run(tasks: SimpleQueue[tuple[Future[bytes], Callable[[], bytes]]]) -> None:
        while True:
            future, read = tasks.get()
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(read())
                except BaseException as error:  # noqa: BLE001 - it is raised where the result is read
                    future.set_exception(error)
            del future, read  # which hold the bytes


BACKGROUND = BackgroundReads()
