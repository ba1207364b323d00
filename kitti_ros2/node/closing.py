# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Closes a node in bounded time, independent of its subscribers.

A reliable writer of Cyclone DDS and its deletion block while a subscriber does not acknowledge:
seconds for each topic.
"""

from __future__ import annotations

import threading
from contextlib import ExitStack
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

    from ..player.to_the_end import StopRequest

EXIT_S = 1.8
"""Time for closing, of the 2 s for an exit; the interpreter needs the rest."""


class Closing:
    """A context manager that calls its callbacks at exit, last one first, in bounded time.

    Args:
        stop_request: Its abandon is called if closing takes too long.

    Attributes:
        seconds: Time limit of the callbacks.
    """

    def __init__(self, stop_request: StopRequest) -> None:
        self.seconds = EXIT_S
        self._stop_request = stop_request
        self._stack = ExitStack()
        self._error: BaseException | None = None

    def callback(self, callback: Callable[..., object], *args: object) -> None:
        """Add a callback."""
        self._stack.callback(callback, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, reason: type[BaseException] | None, *_: object) -> None:
        thread = threading.Thread(target=self._close, name='closing', daemon=True)
        thread.start()
        thread.join(self.seconds)
        if thread.is_alive():
            self._stop_request.abandon()
        if self._error is not None and reason is None:  # else it would hide the reason: Ctrl-C
            raise self._error

    def _close(self) -> None:
        try:
            self._stack.close()
        except BaseException as error:  # noqa: BLE001 - the main thread raises it
            self._error = error
