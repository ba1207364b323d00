# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that make calls, for programs whose signal handlers raise exceptions.

concurrent.futures is not made for those. Its futures and its executor share conditions with their
threads, and an exception that comes right after threading.Condition has taken its lock leaves it
taken: the thread waits for it for ever, and its waiters do, too. What is shared here
are locks and a queue of C, which take a lock and note that they have it in one step.

Signals are held back while a step runs that must not be cut in two.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator
    from types import FrameType

    from typing_extensions import ParamSpec, Self


if TYPE_CHECKING:
    Handler: TypeAlias = Callable[[int, FrameType | None], object]

_DEFERRED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class DeferredSignals:
    """A context manager that handles the first signal that ends a program when the block ends.

    Only in the main thread, which handles them; elsewhere, nothing happens. Signals that are
    ignored stay ignored, and those that Python does not handle end the process at once. Close it
    at the end.
    """

    def __init__(self) -> None:
        self._before: dict[int, Handler] = {}
        self._deferring = False
        self._pending: tuple[int, FrameType | None] | None = None
        if threading.current_thread() is threading.main_thread():
            for number in _DEFERRED:
                handler = signal.getsignal(number)
                if callable(handler):
                    self._before[number] = handler
                    signal.signal(number, self._handle)

    def __enter__(self) -> Self:
        self._deferring = True
        return self

    def __exit__(self, *_: object) -> None:
        self._deferring = False
        if self._pending is not None:
            (number, frame), self._pending = self._pending, None
            self._before[number](number, frame)

    def close(self) -> None:
        """Give the signals back to their handlers; does nothing the second time."""
        # Signals that come meanwhile, or to one that was made later, still find the handlers here.
        for number, handler in self._before.items():
            if signal.getsignal(number) == self._handle:
                signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._deferring:
            self._pending = self._pending or (number, frame)
        else:
            self._before[number](number, frame)


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Hold back signals that end the program until the context ends, then handle them.

    An exception of a handler would leave what is being removed half-removed.
    """
    signals = DeferredSignals()
    try:
        with signals:
            yield
    finally:
        signals.close()


# Threads that make calls, for programs whose signal handlers raise exceptions.
#
# concurrent.futures is not made for those. Its futures and its executor share conditions with their
# threads, and an exception that comes right after threading.Condition has taken its lock leaves it
# taken: the thread waits for it for ever, and its waiters do, too. What is shared here
# are locks and a queue of C, which take a lock and note that they have it in one step.

R = TypeVar('R')


class ThreadTask(Generic[R]):
    """A call that a thread makes.

    Args:
        call: The function.
        ended: The task is put there when it has ended.
    """

    def __init__(
        self, call: Callable[[], R], ended: SimpleQueue[ThreadTask[R]] | None = None
    ) -> None:
        self._call: Callable[[], R] | None = call
        self._all_ended = ended
        self._ended = Lock()
        self._ended.acquire()
        self._results: list[R] = []
        self._error: BaseException | None = None

    def run(self) -> None:
        """Make the call; it is forgotten then, with what it holds."""
        call, self._call = self._call, None
        if call is None:
            self._error = RuntimeError('the call was cancelled')
        else:
            try:
                self._results.append(call())
            except BaseException as error:  # noqa: BLE001 - it is raised where the result is taken
                self._error = error
        self._ended.release()
        if self._all_ended is not None:
            self._all_ended.put(self)

    def cancel(self) -> None:
        """Forget the call, unless a thread makes it already."""
        self._call = None

    def error(self) -> BaseException | None:
        """Wait for the end, and return the exception that was raised."""
        with self._ended:
            return self._error

    def has_failed(self) -> bool:
        """Return whether it has ended, by an exception."""
        return self._error is not None

    def result(self) -> R:
        """Wait for the end, and return the result, or raise the exception."""
        with self._ended:
            pass
        if self._error is None:
            return self._results[0]
        try:
            raise self._error
        finally:
            del self  # the traceback holds this frame, and the error the traceback


class Threads:
    """Threads that take tasks in their order; the first tasks start them.

    Args:
        most: Number of threads.
        name: Name of the threads, to which their number is added.
    """

    def __init__(self, most: int, name: str) -> None:
        self._most = most
        self._name = name
        self._threads: list[Thread] = []
        self._tasks: SimpleQueue[ThreadTask[Any] | None] = SimpleQueue()

    def submit(
        self, call: Callable[[], R], ended: SimpleQueue[ThreadTask[R]] | None = None
    ) -> ThreadTask[R]:
        """Have a thread make a call.

        Args:
            call: The function.
            ended: The task is put there when it has ended.

        Raises:
            RuntimeError: The system has no thread left, not even a first one.
        """
        if len(self._threads) < self._most:
            self._start()
        task = ThreadTask(call, ended)
        self._tasks.put(task)
        return task

    def close(self) -> None:
        """Cancel the tasks that wait, and wait for the threads to end."""
        with suppress(Empty):
            while task := self._tasks.get_nowait():
                task.cancel()
                task.run()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads:
            thread.join()
        self._threads.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _start(self) -> None:
        name = f'{self._name}_{len(self._threads)}'
        # A daemon: a generator that nobody closes must not keep the process from its end.
        thread = Thread(target=_work, args=(self._tasks,), name=name, daemon=True)
        try:
            with deferred_signals():
                thread.start()
                self._threads.append(thread)
        except RuntimeError:
            if not self._threads:
                raise
            self._most = len(self._threads)


def _work(tasks: SimpleQueue[ThreadTask[Any] | None]) -> None:
    while (task := tasks.get()) is not None:
        task.run()
        del task  # with its result, before the next one comes


# Threads whose results come in the order of the tasks, with a bounded number of them pending.

if TYPE_CHECKING:
    P = ParamSpec('P')

T = TypeVar('T')

_MOST_WORKERS = 8  # each may hold images or chunks of several megabytes
_AHEAD_PER_WORKER = 2
_ONE_THREAD: list[bool] = []


def limit_to_one_thread() -> None:
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
