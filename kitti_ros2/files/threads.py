# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that make calls, for programs whose signal handlers raise exceptions.

concurrent.futures is not made for those. Its futures and its executor share conditions with their
threads, and an exception that comes right after threading.Condition has taken its lock leaves it
taken: the thread waits for it for ever, and so does who waits for the thread. What is shared here
are locks and a queue of C, which take a lock and note that they have it in one step.
"""

from __future__ import annotations

from contextlib import suppress
from queue import Empty, SimpleQueue
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .signal_hold import deferred_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

R = TypeVar('R')


class ThreadTask(Generic[R]):
    """A call that a thread makes.

    Args:
        call: What to call.
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
        """Whether it has ended, by an exception."""
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
        name: Of the threads, to which their number is added.
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
            call: What to call.
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
