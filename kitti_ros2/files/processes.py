# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that map in order, for functions that hold the interpreter's lock most of the time.

They are forked: a new interpreter would import numpy first, which takes 0.2 s. A fork copies the
calling thread only, and locks that other threads hold stay locked in the copy (POSIX, fork).

Also the imports, freed memory and OpenCV threads of a process.
"""

from __future__ import annotations

import ctypes
import gc
import signal
import sys
import threading
import time
import warnings
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from ..model.errors import KittiRos2Error

if TYPE_CHECKING:
    import pickle
    from collections.abc import Callable, Iterator, Sequence
    from multiprocessing.connection import Connection


@contextmanager
def one_opencv_thread(*, imported: bool) -> Iterator[None]:
    """End OpenCV's threads, so that processes can be forked which use it.

    Args:
        imported: Import OpenCV if it is not: once here takes less than once in each fork.
    """
    if not imported and 'cv2' not in sys.modules:
        yield
        return
    import cv2  # noqa: PLC0415 - 0.2 s

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


# Imports are not collected as garbage.


def freeze_imports() -> None:
    """Enable the collector that a program disabled at its start, without the objects of imports.

    Where the collector is enabled, what it has not collected yet stays its.
    """
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


@contextmanager
def imports_of_a_worker() -> Iterator[None]:
    """Keep what a process that starts imports inside; it has made nothing else yet."""
    gc.disable()
    try:
        yield
    finally:
        freeze_imports()


# Freed blocks are kept for the next message or image, but not for days.


# From glibc's malloc.h; other C libraries have no mallopt, or ignore unknown parameters.
_M_TRIM_THRESHOLD = -1
_M_MMAP_THRESHOLD = -3
_M_ARENA_MAX = -8
_KEPT_BYTES = 128 << 20
_BLOCK_BYTES = 32 << 20
_GIVEN_BACK_EVERY_S = 60.0


def keep_freed_memory() -> None:
    """Reuse freed blocks instead of returning them to the kernel.

    A returned block costs a page fault for each 4 kB when it is allocated again: a tenth of the
    time of decoding a drive's images.
    """
    mallopt = getattr(ctypes.CDLL(None), 'mallopt', None)
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, 1)  # else each thread keeps as much for itself
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)
        mallopt(_M_MMAP_THRESHOLD, _BLOCK_BYTES)


class FreeMemory:
    """Returns free memory to the kernel once a minute, for a process that runs for days.

    Blocks of many sizes leave free pages between those in use; in hours they would add up. With
    50 MB in use it takes 1 to 4 ms, and 3 MB are returned. Only glibc has it.
    """

    def __init__(self) -> None:
        self._trim = getattr(ctypes.CDLL(None), 'malloc_trim', None)
        self._next_s = time.monotonic() + _GIVEN_BACK_EVERY_S

    def give_back(self) -> None:
        """Return free pages if it is time; call it where nothing waits for a few milliseconds."""
        now = time.monotonic()
        if self._trim is not None and now >= self._next_s:
            self._next_s = now + _GIVEN_BACK_EVERY_S
            self._trim(0)


# Memory shared with a forked process, for results with large buffers.
#
# A result is pickled by protocol 5: its large buffers go through the memory, the rest through a
# pipe. The memory has no name, so nothing is left of it however the processes end.

_SLOTS = 2  # one is filled while the other is read
_SHARED_FROM = 16 * 2**10
"""Below this size in bytes, the pipe costs no more."""


class PickledResult(NamedTuple):
    """A pickled result.

    Attributes:
        pickled: All but the shared buffers.
        slot: The slot of these; None without any.
        ends: The end of each in the slot, ascending.
    """

    pickled: bytes
    slot: int | None
    ends: list[int]


class SharedSlots:
    """Slots of shared memory, each with the buffers of one result until it is taken.

    Args:
        size: Bytes of a slot; buffers that do not fit are pickled. Pages are allocated when used.
    """

    def __init__(self, size: int) -> None:
        import mmap  # noqa: PLC0415 - as in _Fork

        self._size = size
        self._memory = mmap.mmap(-1, _SLOTS * size)
        self._free = list(range(_SLOTS))

    def pack(self, result: object, wait_for_slot: Callable[[], int]) -> PickledResult:
        """Pickle a result, its buffers (pickle.PickleBuffer) in a slot.

        Args:
            result: The result.
            wait_for_slot: Returns the number of a slot that was taken; called if none is free.
        """
        import pickle  # noqa: PLC0415 - as in _Fork

        slot: int | None = None
        ends: list[int] = []

        def is_pickled(buffer: pickle.PickleBuffer) -> bool:
            nonlocal slot
            with buffer.raw() as data:
                start = ends[-1] if ends else 0
                if len(data) < _SHARED_FROM or start + len(data) > self._size:
                    return True
                if slot is None:
                    slot = self._free.pop() if self._free else wait_for_slot()
                offset = slot * self._size + start
                self._memory[offset : offset + len(data)] = data
                ends.append(start + len(data))
                return False

        return PickledResult(
            pickle.dumps(result, protocol=5, buffer_callback=is_pickled), slot, ends
        )

    def take(self, packed: PickledResult) -> Any:  # noqa: ANN401 - whatever was packed
        """Return a result; its slot is free then, since its buffers are views of a copy."""
        import pickle  # noqa: PLC0415 - as in _Fork

        if packed.slot is None:
            return pickle.loads(packed.pickled)  # noqa: S301 - of a process of this program
        start = packed.slot * self._size
        data = memoryview(self._memory[start : start + packed.ends[-1]])
        starts = [0, *packed.ends[:-1]]
        buffers = [data[a:b] for a, b in zip(starts, packed.ends, strict=True)]
        return pickle.loads(packed.pickled, buffers=buffers)  # noqa: S301 - as above

    def close(self) -> None:
        """Release the memory."""
        self._memory.close()


# Processes that map in order, for functions that hold the interpreter's lock most of the time.
#
# They are forked: a new interpreter would import numpy first, which takes 0.2 s. A fork copies the
# calling thread only, and locks that other threads hold stay locked in the copy (POSIX, fork).

T = TypeVar('T')
R = TypeVar('R')

_ENDING = {signal.SIGINT, signal.SIGTERM}


def can_fork() -> bool:
    """Return whether a fork is safe here: on Linux, in a program without threads of Python."""
    return sys.platform == 'linux' and threading.active_count() == 1


def forked_map(function: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """Map in order on forked processes; as forked, the processes start with the first result.

    Raises:
        KittiRos2Error: A process was killed, for example when memory ran out.
        Exception: That of the function.
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
        KittiRos2Error: By the iterator: a process was killed, for example when memory ran out.
        Exception: By the iterator: that of the function.
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
        not_theirs = [*(other.connection for other in others), self.connection]
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
            Exception: That of the function.
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
        unpacked: R = result if self._slots is None else self._slots.take(result)
        if self._slots is not None and result.slot is not None:
            with suppress(BrokenPipeError, ConnectionResetError):  # noticed by the next receive
                self.connection.send(result.slot)
        return unpacked

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
    # The other end is closed when no more results are needed.
    with suppress(BrokenPipeError, ConnectionResetError, EOFError):
        for item in items:
            try:
                result: Any = function(item)
            except Exception as error:  # noqa: BLE001 - raised where the results are taken
                connection.send((None, error))
                return
            connection.send((slots.pack(result, connection.recv) if slots else result, None))
