# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that map in order, for functions that hold the interpreter's lock most of the time.

They are forked: a new interpreter would import numpy first, which takes 0.2 s. A fork copies the
calling thread only, and locks that other threads hold stay locked in the copy (POSIX, fork).
"""

from __future__ import annotations

import signal
import sys
import threading
import warnings
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..model.errors import KittiRos2Error
from .shared_slots import SharedSlots

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection

T = TypeVar('T')
R = TypeVar('R')

_ENDING = {signal.SIGINT, signal.SIGTERM}


def can_fork() -> bool:
    """Whether a fork is safe here: on Linux, in a program without threads of Python."""
    return sys.platform == 'linux' and threading.active_count() == 1


def forked_map(function: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """Map in order on forked processes; as forked, the processes start with the first result.

    Raises:
        KittiRos2Error: A process was killed, for example for lack of memory.
        Exception: What the function raises.
    """
    with forked(function, items, workers) as results:
        yield from results


@contextmanager
def forked(
    function: Callable[[T], R], items: Sequence[T], workers: int, slot_bytes: int = 0
) -> Iterator[Iterator[R]]:
    """Yield the results of a function in order; it runs on processes, each takes every n-th item.

    The processes start at once. They wait while their results are not taken, and end with the
    context, or when this process ends.

    Args:
        function: Called there; what it changes stays there. Its results are pickled.
        items: Its arguments.
        workers: Number of processes.
        slot_bytes: Memory for the buffers of a result, which are not pickled; see SharedSlots. Two
            for each process. 0: none.

    Raises:
        KittiRos2Error: By the iterator: a process was killed, for example for lack of memory.
        Exception: By the iterator: what the function raises.
    """
    pool: list[_Fork[T, R]] = []
    try:
        with _without_signals():
            for first in range(min(workers, len(items))):
                pool.append(_Fork(function, items[first::workers], slot_bytes, pool))
        yield (pool[index % workers].receive() for index in range(len(items)))
    finally:
        for worker in pool:
            worker.stop()
        for worker in pool:
            worker.join()


class _Fork(Generic[T, R]):
    """A forked process that sends the result of each of its items.

    Args:
        function: Called there.
        items: Its arguments.
        slot_bytes: As in forked.
        others: The workers that were started before.

    Attributes:
        connection: To the process.
    """

    def __init__(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        slot_bytes: int,
        others: Sequence[_Fork[T, R]],
    ) -> None:
        import multiprocessing  # noqa: PLC0415 - for those that fork

        context = multiprocessing.get_context('fork')
        self.connection, theirs = context.Pipe()
        self._slots = SharedSlots(slot_bytes) if slot_bytes else None
        not_theirs = [*(each.connection for each in others), self.connection]
        self._process = context.Process(
            target=_work, args=(function, items, theirs, not_theirs, self._slots), daemon=True
        )
        with theirs, warnings.catch_warnings():
            # Python 3.12 warns of the threads of BLAS as well, which expects forks.
            warnings.simplefilter('ignore', DeprecationWarning)
            self._process.start()

    def receive(self) -> R:
        """Wait for the next result.

        Raises:
            KittiRos2Error: The process was killed.
            Exception: What the function raised.
        """
        try:
            result, error = self.connection.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            code = self._process.exitcode or 0
            how = f'was killed by signal {-code}' if code < 0 else f'ended with exit code {code}'
            raise KittiRos2Error(f'a worker process {how}; is there enough memory?') from None
        if error is not None:
            raise error
        taken: R = result if self._slots is None else self._slots.take(result)
        if self._slots is not None and result.slot is not None:
            with suppress(BrokenPipeError, ConnectionResetError):  # noticed by the next receive
                self.connection.send(result.slot)
        return taken

    def stop(self) -> None:
        """End the process."""
        self.connection.close()
        self._process.terminate()

    def join(self) -> None:
        """Wait until the process has ended."""
        self._process.join()
        if self._slots is not None:
            self._slots.close()


@contextmanager
def _without_signals() -> Iterator[None]:
    """Block the signals that end a program: exceptions in the hooks of a fork would be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(
    function: Callable[[T], R],
    items: Sequence[T],
    connection: Connection[Any, Any],
    not_ours: Sequence[Connection[Any, Any]],
    slots: SharedSlots | None,
) -> None:
    """Send the result of each item, or the first error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
    for other in not_ours:  # as long as one is open, a pipe without a reader is not broken
        other.close()
    # The other end is closed when the results are not wanted any more.
    with suppress(BrokenPipeError, ConnectionResetError, EOFError):
        for item in items:
            try:
                result: Any = function(item)
            except Exception as error:  # noqa: BLE001 - raised where the results are taken
                connection.send((None, error))
                return
            connection.send((slots.pack(result, connection.recv) if slots else result, None))
