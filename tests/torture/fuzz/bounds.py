# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What an input may cost: of n bytes 100 MB + 20 n of memory, and 1 s + n / (1 MB/s)."""

from __future__ import annotations

import resource
import signal
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_STATUS = Path('/proc/self/statm')
_CLEAR = Path('/proc/self/clear_refs')
_KB = 1024


class TooSlowError(BaseException):
    """An input took too long; not an Exception, which readers may catch."""


class TooLargeError(BaseException):
    """An input took too much memory."""


def _now_bytes() -> int:
    try:
        return int(_STATUS.read_text().split()[1]) * resource.getpagesize()
    except OSError:
        return _peak_bytes()


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _KB


class Bounds:
    """Measures what inputs cost in this process, in CPU time and resident memory.

    Attributes:
        slowest_s, largest_bytes: The most of any input so far.
    """

    def __init__(self) -> None:
        self.reset()
        self.slowest_s = 0.0
        self.largest_bytes = 0

    def reset(self) -> None:
        """Take the memory that is used now as what inputs add to."""
        with suppress(OSError):
            _CLEAR.write_text('5')  # the peak becomes what is used now
        self._base = _now_bytes()

    @contextmanager
    def applied(self, size: int) -> Iterator[None]:
        """Raise where the block costs more than an input of a size may.

        Raises:
            TooSlowError, TooLargeError: It does.
        """
        seconds = 1 + size / 1e6
        most = 100_000_000 + 20 * size
        signal.signal(signal.SIGPROF, _stop)
        signal.setitimer(signal.ITIMER_PROF, 1.5 * seconds)
        start = time.process_time()
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        spent = time.process_time() - start
        self.slowest_s = max(self.slowest_s, spent)
        grown = _peak_bytes() - self._base
        self.largest_bytes = max(self.largest_bytes, grown)
        if grown > most:
            self.reset()
            raise TooLargeError(f'{grown / 1e6:.0f} MB for {size} bytes')
        if spent > seconds:
            raise TooSlowError(f'{spent:.1f} s for {size} bytes')


def _stop(*_: object) -> None:
    raise TooSlowError('stopped')


@contextmanager
def address_space(limit: int) -> Iterator[None]:
    """Bound the process, so that a bomb is a MemoryError and not the end of the machine."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    virtual = int(_STATUS.read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (virtual + limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
