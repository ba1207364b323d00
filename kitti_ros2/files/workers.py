# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads whose results come in the order of the tasks, with a bounded number of them pending."""

from __future__ import annotations

import os
from collections import deque
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Generic, TypeVar

from .signal_hold import deferred_signals
from .threads import Threads

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from typing_extensions import ParamSpec, Self

    from .threads import ThreadTask

    P = ParamSpec('P')

T = TypeVar('T')
R = TypeVar('R')

_MOST_WORKERS = 8  # each may hold images or chunks of several megabytes
_AHEAD_PER_WORKER = 2
_ONE_THREAD: list[bool] = []


def hold_to_one_thread() -> None:
    """Let worker_count return 1 in this process from now on: it is one of several workers."""
    _ONE_THREAD[:] = [True]


def worker_count(most: int | None = _MOST_WORKERS) -> int:
    """Return the number of threads to use: one per available CPU, at most `most` unless None.

    It is one in a process that is held to one thread.
    """
    if _ONE_THREAD:
        return 1
    available = len(os.sched_getaffinity(0))
    return available if most is None else min(most, available)


class OrderedPool(Generic[R]):
    """A pool of threads for tasks that release the interpreter's lock.

    Results and exceptions of tasks reach the caller's thread, inside put and drain.

    Args:
        workers: Number of threads.
        ahead: Number of tasks that may be pending besides one of each worker.
    """

    def __init__(self, workers: int, ahead: int) -> None:
        self._threads = Threads(workers, 'worker')
        self._most_pending = workers + ahead
        self._pending: deque[ThreadTask[R]] = deque()

    def put(self, task: Callable[[], R]) -> list[R]:
        """Submit a task; return the oldest pending result if the pool was full, else nothing."""
        full = len(self._pending) >= self._most_pending
        results = [self._pending.popleft().result()] if full else []
        self._pending.append(self._threads.submit(task))
        return results

    def drain(self) -> Iterator[R]:
        """Yield the results that are left, waiting for each."""
        while self._pending:
            yield self._pending.popleft().result()

    def close(self) -> None:
        """Cancel pending tasks and wait for the threads to end, whatever signal arrives."""
        self._pending.clear()
        with deferred_signals():
            self._threads.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SpareThreads:
    """Threads for work that may as well be done in turn: as many as worker_count, if over one.

    The work should release the interpreter's lock.
    """

    def __init__(self) -> None:
        workers = worker_count()
        self._threads = Threads(workers, 'spare') if workers > 1 else None

    def submit(
        self, call: Callable[P, R], *args: P.args, **kwargs: P.kwargs
    ) -> ThreadTask[R] | None:
        """Have a thread make a call; None if there is no thread for it."""
        if self._threads is not None:
            try:
                return self._threads.submit(partial(call, *args, **kwargs))
            except RuntimeError:  # the system has no thread left
                self._threads = None
        return None

    def close(self) -> None:
        """Cancel the tasks that wait, and wait for the others to end."""
        if self._threads is not None:
            self._threads.close()


def ordered_map(
    function: Callable[[T], R], items: Iterable[T], workers: int, batch: int = 1
) -> Generator[R, None, None]:
    """Map in order on a pool of threads, at most a few batches ahead.

    Close what it returns, as contextlib.closing does, where the function writes: the threads go on
    after an exception of the caller's until then.

    Args:
        function: Called in the pool.
        items: Its arguments.
        workers: Number of threads.
        batch: Number of items that a thread takes at a time. Handing over a batch costs about
            0.1 ms, as much as a short call does.
    """

    def work(some: list[T]) -> list[R]:
        return [function(item) for item in some]

    rest = iter(items)
    with OrderedPool[list[R]](workers, workers * _AHEAD_PER_WORKER) as pool:
        while some := list(islice(rest, batch)):
            for results in pool.put(partial(work, some)):
                yield from results
        for results in pool.drain():
            yield from results
