# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Prefetches messages on a pool of threads, so that publishing does not wait for them."""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from itertools import islice
from typing import TYPE_CHECKING

from ..files.signal_hold import deferred_signals

if TYPE_CHECKING:
    from concurrent.futures import Future

    from typing_extensions import Self

    from ..messages.cdr import Message
    from ..model.losses import Loss
    from .program import Program

    Fetched = tuple[list[Message], list[Loss]]


_NICENESS = 10


class ReadAhead:
    """Prefetches a bounded number of samples of a program; for one consuming thread.

    In the main thread, signals wait until a method has ended: see files.threads.

    At the end it continues at the beginning: a loop has no gap; a single pass wastes a few samples.

    Args:
        program: The program.
        samples: Number of samples to prefetch.
        polite: Whether the threads run at a lower priority.
    """

    def __init__(self, program: Program, samples: int, *, polite: bool) -> None:
        self._program = program
        self._total = len(program.stamps_ns)
        self._size = max(1, min(samples, self._total))
        self._pool = ThreadPoolExecutor(
            program.workers,
            thread_name_prefix='read-ahead',
            initializer=_step_back if polite else None,
        )
        self._ahead: deque[_Sample] = deque()
        self._next = 0
        self._wanted: frozenset[int] = frozenset()

    def __enter__(self) -> Self:
        return self

    @deferred_signals()
    def __exit__(self, *_: object) -> None:
        self._drop()
        self._pool.shutdown(wait=True, cancel_futures=True)

    @deferred_signals()
    def want(self, wanted: frozenset[int], *, at_once: bool = True) -> None:
        """Set the outlets with subscribers; samples fetched without a new one are fetched again.

        Args:
            wanted: The outlets.
            at_once: Whether the next sample is made for them, though it may be late. If not, those
                that are there are taken until they are fetched again: a new subscriber, which
                always comes in between, does not hold up all others.
        """
        added = wanted - self._wanted
        self._wanted = wanted
        if not added:
            return
        if at_once:
            self._drop()
        for number, sample in enumerate(self._ahead):
            sample.fetch_again(self._fetch(number))

    @deferred_signals()
    def prepare(self, position: int, samples: int) -> None:
        """Wait until samples from a position on are there, within the limit.

        An error of one comes when it is taken.
        """
        self._go_to(position)
        samples = min(samples, self._size)
        while len(self._ahead) < samples:
            self._submit()
        for sample in islice(self._ahead, samples):
            sample.wait()

    @deferred_signals()
    def take(self, position: int) -> Fetched:
        """Return the messages at a position; continue prefetching from there."""
        self._go_to(position)
        self._next = (position + 1) % self._total
        return self._ahead.popleft().result()

    def _go_to(self, position: int) -> None:
        """Forget what is ahead, unless that is the sample at a position, and fetch this."""
        if position != self._next:
            self._drop()
            self._next = position
        if not self._ahead:
            self._submit()

    @deferred_signals()
    def refill(self) -> None:
        """Start prefetching up to the limit."""
        while len(self._ahead) < self._size:
            self._submit()

    def low(self) -> bool:
        """Whether less than half of the limit is prefetched."""
        return len(self._ahead) * 2 < self._size

    def _submit(self) -> None:
        self._ahead.append(_Sample(self._fetch(len(self._ahead))))

    def _fetch(self, number: int) -> Future[Fetched]:
        position = (self._next + number) % self._total
        return self._pool.submit(self._program.fetch, position, self._wanted)

    def _drop(self) -> None:
        for sample in self._ahead:
            sample.cancel()
        self._ahead.clear()


class _Sample:
    """A sample that is being fetched, perhaps again for more outlets."""

    def __init__(self, fetched: Future[Fetched]) -> None:
        self._fetched = fetched
        self._again: Future[Fetched] | None = None

    def fetch_again(self, future: Future[Fetched]) -> None:
        """Prefer another result, as soon as it is there."""
        if self._again is not None and not self._again.cancel():
            self._fetched = self._again
        if self._fetched.cancel():  # it has not begun
            self._fetched, self._again = future, None
        else:
            self._again = future

    def wait(self) -> None:
        """Wait until there is a result."""
        wait([self._fetched, *([self._again] if self._again else [])], return_when=FIRST_COMPLETED)

    def result(self) -> Fetched:
        """Return the result that is there, or wait for the first one."""
        if self._again is not None and self._again.done():
            return self._again.result()
        if self._again is not None:
            self._again.cancel()
        return self._fetched.result()

    def cancel(self) -> None:
        """Give up what has not begun."""
        self._fetched.cancel()
        if self._again is not None:
            self._again.cancel()


def _step_back() -> None:
    """Lower the priority of this thread; on Linux niceness is per thread."""
    if sys.platform == 'linux':
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
