# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Exit codes, and a clean exit on Ctrl-C and SIGTERM."""

from __future__ import annotations

import os
import select
import signal
import sys
from contextlib import suppress
from functools import lru_cache

# Exit codes of the command line.


EXIT_OK = 0
"""Everything was written; or the reader of the output closed it early, as `head` does."""
EXIT_LOSSES = 1
"""Some data was missing or bad: it is listed, also with -q, and everything else was written."""
EXIT_USAGE = 2
"""Invalid usage, or an unreadable input or output: one line says what to do."""
EXIT_INTERRUPTED = 130
"""Interrupted by Ctrl-C; no incomplete output is left behind."""
EXIT_TERMINATED = 143
"""Ended by SIGTERM; no incomplete output is left behind."""


# Clean exit on Ctrl-C and SIGTERM for a command that runs until it is stopped.


class Ending:
    """A latch that signal handlers may set; a pipe, because a lock could already be held."""

    def __init__(self) -> None:
        self._reader, self._writer = _pipe()
        self._woken, self._waker = _pipe()
        self._abandoned = False

    def watch(self, *numbers: signal.Signals) -> None:
        """Let signals set the latch from now on.

        Python runs their handlers in the main thread, between two of its instructions. A signal
        that another thread takes, or that comes just before the main thread blocks, would be
        handled only when the wait ends; the wakeup file ends it.
        """
        signal.set_wakeup_fd(self._waker, warn_on_full_buffer=False)
        for number in numbers:
            signal.signal(number, lambda *_: self.set())

    def set(self) -> None:
        """Set the latch, which ends the wait."""
        with suppress(BlockingIOError):  # the pipe is full, so it is set
            os.write(self._writer, b'.')

    def wait(self) -> None:
        """Block until the latch is set."""
        while self._reader not in select.select([self._reader, self._woken], [], [])[0]:
            os.read(self._woken, select.PIPE_BUF)

    def abandon(self) -> None:
        """Make leave end the process at once, because something cannot be closed."""
        self._abandoned = True

    def leave(self, code: int) -> None:
        """End the process at once after abandon; a normal exit would wait for what cannot close."""
        if self._abandoned:
            for stream in (sys.stdout, sys.stderr):
                with suppress(OSError):  # a full disk, or a pipe that nobody reads
                    stream.flush()
            os._exit(code)


@lru_cache(maxsize=1)
def end_by_signal() -> Ending:
    """Return the latch of this process, which SIGINT and SIGTERM set from now on."""
    ending = Ending()
    ending.watch(signal.SIGINT, signal.SIGTERM)
    return ending


def _pipe() -> tuple[int, int]:
    """Return both ends of a pipe; writing to a full one is refused."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    return reader, writer
