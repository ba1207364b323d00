# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Work done on all cores, its results taken in the order it was given."""

from __future__ import annotations

import os
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

_MAX_WORKERS = 8

Result = TypeVar('Result')


class OrderedPool(Generic[Result]):
    """Threads for work that lets go of the interpreter's lock; a bounded number of it is under way.

    Results are taken on the caller's thread, inside put and drain, which also raise what the work
    raised.
    """

    def __init__(self) -> None:
        workers = min(_MAX_WORKERS, len(os.sched_getaffinity(0)))
        self._threads = ThreadPoolExecutor(workers, 'compress')
        self._limit = workers + 2
        self._pending: deque[tuple[Future[Result], Callable[[Result], None]]] = deque()

    def put(self, work: Callable[[], Result], take: Callable[[Result], None]) -> None:
        """Have work done, and its result taken after those before it."""
        self._take(self._limit - 1)
        self._pending.append((self._threads.submit(work), take))

    def drain(self) -> None:
        """Wait until every result is taken."""
        self._take(0)

    def close(self) -> None:
        """Drop what is not done, and wait for the threads to end."""
        self._pending.clear()
        self._threads.shutdown(cancel_futures=True)

    def _take(self, limit: int) -> None:
        while len(self._pending) > limit:
            future, take = self._pending.popleft()
            take(future.result())
