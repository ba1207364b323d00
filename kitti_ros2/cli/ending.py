# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and SIGTERM as a clean way out for a command that runs until it is told to end."""

from __future__ import annotations

import os
import select
import signal
import sys
from contextlib import suppress
from functools import lru_cache


class Ending:
    """A latch that signal handlers may set: a pipe, for a lock could be held already."""

    def __init__(self) -> None:
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._abandoned = False

    def set(self) -> None:
        """Let the wait end."""
        with suppress(BlockingIOError):  # then it is more than set
            os.write(self._writer, b'.')

    def wait(self) -> None:
        """Wait until it is set."""
        select.select([self._reader], [], [])

    def abandon(self) -> None:
        """Let leave end the process without what cannot be closed."""
        self._abandoned = True

    def leave(self, code: int) -> None:
        """End the process at once where something cannot be closed: an exit would wait for it."""
        if self._abandoned:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)


@lru_cache(maxsize=1)
def end_by_signal() -> Ending:
    """The ending of this process, which SIGINT and SIGTERM set from now on."""
    ending = Ending()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    return ending
