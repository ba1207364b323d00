# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Signals held back while a step runs that must not be cut in two."""

from __future__ import annotations

import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import FrameType

    from typing_extensions import Self

    Handler: TypeAlias = Callable[[int, FrameType | None], object]

_HELD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class SignalHold:
    """As a context manager: the first signal that ends a program is handled when the block ends.

    Only in the main thread, which handles them; elsewhere, nothing happens. Signals that are
    ignored stay ignored, and those that Python does not handle end the process at once. Close it
    at the end.
    """

    def __init__(self) -> None:
        self._before: dict[int, Handler] = {}
        self._holding = False
        self._pending: tuple[int, FrameType | None] | None = None
        if threading.current_thread() is threading.main_thread():
            for number in _HELD:
                handler = signal.getsignal(number)
                if callable(handler):
                    self._before[number] = handler
                    signal.signal(number, self._handle)

    def __enter__(self) -> Self:
        self._holding = True
        return self

    def __exit__(self, *_: object) -> None:
        self._holding = False
        if self._pending is not None:
            (number, frame), self._pending = self._pending, None
            self._before[number](number, frame)

    def close(self) -> None:
        """Give the signals back to their handlers; does nothing the second time."""
        # Signals that come meanwhile, or to one that was made later, still find the handlers here.
        for number, handler in self._before.items():
            if signal.getsignal(number) == self._handle:
                signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self._holding:
            self._pending = self._pending or (number, frame)
        else:
            self._before[number](number, frame)


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Hold back signals that end the program until the context ends, then handle them.

    An exception of a handler would leave what is being removed half-removed.
    """
    hold = SignalHold()
    try:
        with hold:
            yield
    finally:
        hold.close()
