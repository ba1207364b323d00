# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The only place of the tests that polls."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE_S = 120.0
"""Far more than any condition takes on a busy machine."""


def wait_until(condition: Callable[[], object], seconds: float = PATIENCE_S) -> None:
    """Wait until a condition holds.

    Raises:
        AssertionError: It did not hold in time.
    """
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f'the condition did not hold within {seconds:g} s'
        time.sleep(0.002)


def is_running(pid: int) -> bool:
    """Whether a process is there, also one that has ended and was not waited for."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


UNTIL_A_SIGNAL = """
import os, signal, sys, threading
# A background job of a shell ignores Ctrl-C, and so would what it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)
reader, writer = os.pipe()
os.set_blocking(writer, False)
signal.set_wakeup_fd(writer)
signalled = threading.Event()
threading.Thread(target=lambda: os.read(reader, 1) and signalled.set(), daemon=True).start()
"""
"""The begin of a program: `signalled` is set as soon as the process receives a signal."""
