# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that map in order, for functions that hold the interpreter's lock most of the time.

They are forked: a new interpreter would import numpy first, which takes 0.2 s. A fork copies the
calling thread only, and locks that other threads hold stay locked in the copy (POSIX, fork).
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
import threading
import warnings
from typing import TYPE_CHECKING, Any, TypeVar

from ..model.errors import KittiRos2Error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkProcess

T = TypeVar('T')
R = TypeVar('R')


def can_fork() -> bool:
    """Whether a fork is safe here: on Linux, in a program without threads of Python."""
    return sys.platform == 'linux' and threading.active_count() == 1


def forked_map(function: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """Map in order on forked processes, each of which takes every n-th item.

    The processes wait while their results are not taken, and end with the iterator, or when this
    process ends.

    Args:
        function: Called there; what it changes stays there. Its results are pickled.
        items: Its arguments.
        workers: Number of processes.

    Raises:
        KittiRos2Error: A process was killed, for example for lack of memory.
        Exception: What the function raises.
    """
    receivers: list[Connection] = []
    processes: list[ForkProcess] = []
    try:
        for first in range(min(workers, len(items))):
            receiver, process = _start(function, items[first::workers], receivers)
            receivers.append(receiver)
            processes.append(process)
        for index in range(len(items)):
            place = index % workers
            result, error = _receive(receivers[place], processes[place])
            if error is not None:
                raise error
            yield result
    finally:
        for receiver in receivers:
            receiver.close()
        for process in processes:
            process.terminate()
            process.join()


def _start(
    function: Callable[[T], R], items: Sequence[T], others: Sequence[Connection]
) -> tuple[Connection, ForkProcess]:
    context = multiprocessing.get_context('fork')
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(
        target=_work, args=(function, items, sender, [*others, receiver]), daemon=True
    )
    with warnings.catch_warnings():
        # Python 3.12 warns of the threads of BLAS as well, which expects forks.
        warnings.simplefilter('ignore', DeprecationWarning)
        process.start()
    sender.close()
    return receiver, process


def _receive(receiver: Connection, process: ForkProcess) -> tuple[Any, Exception | None]:
    try:
        received: tuple[Any, Exception | None] = receiver.recv()
    except EOFError:
        process.join()
        code = process.exitcode or 0
        how = f'was killed by signal {-code}' if code < 0 else f'ended with exit code {code}'
        raise KittiRos2Error(f'a worker process {how}; is there enough memory?') from None
    return received


def _work(
    function: Callable[[T], R],
    items: Sequence[T],
    sender: Connection,
    not_ours: Sequence[Connection],
) -> None:
    """Send the result of each item, or the first error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to all processes
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for receiver in not_ours:  # as long as one is open, a pipe without a reader is not broken
        receiver.close()
    try:
        for item in items:
            sender.send((function(item), None))
    except BrokenPipeError:
        return
    except Exception as error:  # noqa: BLE001 - raised where the results are taken
        sender.send((None, error))
