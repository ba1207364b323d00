# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Signals that end a program, held back until a few steps are done."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Hold back signals that end the program until the context ends, then handle them.

    An exception of a handler would leave what is being removed half-removed. Python handles signals
    in the main thread only; in other threads nothing is held back. Signals that are ignored stay
    ignored, and those that Python does not handle end the process at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[int] = []
    before = {number: signal.getsignal(number) for number in _ENDING}
    handled = [number for number, handler in before.items() if callable(handler)]
    try:
        for number in handled:
            signal.signal(number, lambda caught, _: pending.append(caught))
        yield
    finally:
        for number in handled:
            signal.signal(number, before[number])
        for caught in dict.fromkeys(pending):
            signal.raise_signal(caught)
