# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Keys that control a player in a terminal, as `ros2 bag play` has them."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import threading
import tty
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType
    from typing import TextIO

    from typing_extensions import Self

HELP = (
    'keys: space pauses, right plays the next frame, left the one before, up and down change the'
    ' rate, q quits'
)


class Key(Enum):
    """The keys that mean something."""

    SPACE = b' '
    UP = b'A'
    DOWN = b'B'
    RIGHT = b'C'
    LEFT = b'D'
    QUIT = b'q'


_ESCAPE = 0x1B
_ARROW_BEGINS = (b'[', b'O')
_PLAIN = {Key.SPACE.value: Key.SPACE, Key.QUIT.value: Key.QUIT}
_ARROWS = {key.value: key for key in (Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT)}
_REST_OF_ESCAPE_S = 0.05
_LOOK_AGAIN_S = 0.5


class Keyboard:
    """While entered, a thread that acts on keys, where the stream is our terminal; else nothing.

    Args:
        actions: What to do, by key.
        on_error: Told what an action raises.
        stream: Where keys come from.
    """

    def __init__(
        self,
        actions: Mapping[Key, Callable[[], object]],
        on_error: Callable[[Exception], None],
        stream: TextIO = sys.stdin,
    ) -> None:
        self._actions = actions
        self._on_error = on_error
        self._stream = stream
        self._thread: threading.Thread | None = None
        self._attributes: list[Any] = []

    def __enter__(self) -> Self:
        if not _is_our_terminal(self._stream):
            return self
        self._terminal = self._stream.fileno()
        self._attributes = termios.tcgetattr(self._terminal)
        self._reader, self._writer = os.pipe()
        tty.setcbreak(self._terminal, termios.TCSANOW)
        self._thread = threading.Thread(target=self._listen, name='keyboard', daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._thread is None:
            return
        os.write(self._writer, b'.')
        self._thread.join()
        os.close(self._reader)
        os.close(self._writer)
        with contextlib.suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._attributes)

    def _listen(self) -> None:
        while True:
            try:
                ready, _, _ = select.select([self._terminal, self._reader], [], [], _LOOK_AGAIN_S)
                if self._reader in ready:
                    return
                if self._terminal in ready and not self._press():
                    return
                self._set_again()
            except OSError:
                return  # the terminal is gone

    def _press(self) -> bool:
        """Act on one key; False at the end of the stream."""
        byte = os.read(self._terminal, 1)
        key = self._arrow() if byte == bytes([_ESCAPE]) else _PLAIN.get(byte)
        if key is not None and key in self._actions:
            try:
                self._actions[key]()
            except Exception as error:  # noqa: BLE001 - a key must not end the player
                self._on_error(error)
        return bool(byte)

    def _arrow(self) -> Key | None:
        """The arrow whose sequence has begun with an escape; None for anything else."""
        if self._read_soon() not in _ARROW_BEGINS:
            return None
        return _ARROWS.get(self._read_soon())

    def _read_soon(self) -> bytes:
        ready, _, _ = select.select([self._terminal], [], [], _REST_OF_ESCAPE_S)
        return os.read(self._terminal, 1) if ready else b''

    def _set_again(self) -> None:
        """A shell that stopped us (Ctrl-Z) has set its own mode; ours comes back with fg."""
        if not _in_foreground(self._terminal):
            return
        with contextlib.suppress(termios.error):
            if termios.tcgetattr(self._terminal)[3] & termios.ICANON:
                tty.setcbreak(self._terminal, termios.TCSANOW)


def _is_our_terminal(stream: TextIO) -> bool:
    return not stream.closed and stream.isatty() and _in_foreground(stream.fileno())


def _in_foreground(terminal: int) -> bool:
    """Whether keys are for us: a job in the background would be stopped for reading them."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
