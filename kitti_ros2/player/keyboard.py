# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Keyboard input in a terminal; the keys are those of `ros2 bag play`."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import threading
import tty
from enum import Enum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import TextIO

    from typing_extensions import Self

HELP = 'keys: space pause, right next frame, left the one before, up/down rate, q quit'


class Key(Enum):
    """The supported keys."""

    SPACE = b' '
    UP = b'A'
    DOWN = b'B'
    RIGHT = b'C'
    LEFT = b'D'
    QUIT = b'q'


_ESCAPE = b'\x1b'
_ARROW_BEGINS = (b'[', b'O')
_PLAIN = {Key.SPACE.value: Key.SPACE, Key.QUIT.value: Key.QUIT}
_ARROWS = {key.value: key for key in (Key.UP, Key.DOWN, Key.RIGHT, Key.LEFT)}
_REST_OF_ESCAPE_S = 0.05
_LOOK_AGAIN_S = 0.5
_NOT_OURS = termios.ICANON | termios.ECHO
_DEADLY = (signal.SIGQUIT, signal.SIGALRM, signal.SIGUSR1, signal.SIGUSR2)
"""Signals that end a process which does not handle them; the others end it in an orderly way."""


class Keyboard:
    """A context manager whose thread handles keys if the stream is a foreground terminal.

    Args:
        actions: Handlers by key.
        on_error: Called with the exception of a handler.
        stream: Source of keys; None for standard input at the time of entering.
    """

    def __init__(
        self,
        actions: Mapping[Key, Callable[[], object]],
        on_error: Callable[[Exception], None],
        stream: TextIO | None = None,
    ) -> None:
        self._actions = actions
        self._on_error = on_error
        self._stream = stream
        self._thread: threading.Thread | None = None
        self._closing = contextlib.ExitStack()
        self._mode = threading.Lock()
        self._over = False

    @property
    def listening(self) -> bool:
        """Whether keys are handled."""
        return self._thread is not None

    def __enter__(self) -> Self:
        stream = sys.stdin if self._stream is None else self._stream
        if _is_our_terminal(stream):
            # Completed steps are undone if a later one fails.
            with contextlib.ExitStack() as stack:
                self._open(stream.fileno(), stack)
                self._closing = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    def _open(self, terminal: int, stack: contextlib.ExitStack) -> None:
        self._terminal = terminal
        self._reader, writer = os.pipe()
        stack.callback(os.close, self._reader)
        stack.callback(os.close, writer)
        attributes = termios.tcgetattr(terminal)
        stack.callback(_restore, terminal, attributes)
        if threading.current_thread() is threading.main_thread():
            self._restore_at_signals(attributes, stack)
        tty.setcbreak(terminal, termios.TCSANOW)
        self._thread = threading.Thread(target=self._listen, name='keyboard', daemon=True)
        self._thread.start()
        stack.callback(self._thread.join)
        stack.callback(os.write, writer, b'.')

    def _restore_at_signals(self, attributes: list[Any], stack: contextlib.ExitStack) -> None:
        """Restore the mode before a signal ends the process, such as that of Ctrl-Backslash."""

        def end(number: int, _: object) -> None:
            with self._mode:
                self._over = True
                _restore(self._terminal, attributes)
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

        for number in _DEADLY:
            if signal.getsignal(number) is signal.SIG_DFL:
                stack.callback(signal.signal, number, signal.SIG_DFL)
                signal.signal(number, end)

    def _listen(self) -> None:
        # If the process goes to the background before a read, the read fails instead of stopping
        # the job.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTIN, signal.SIGTTOU})
        while True:
            try:
                if not self._turn():
                    return
            except OSError:
                if not os.isatty(self._terminal):
                    return  # the terminal is gone

    def _turn(self) -> bool:
        """Wait for a key or the next check of the terminal; False at the end."""
        watched = [self._reader]
        if in_foreground(self._terminal):
            with self._mode:
                if not self._over:
                    _set_again(self._terminal)
            watched.append(self._terminal)
        ready, _, _ = select.select(watched, [], [], _LOOK_AGAIN_S)
        if self._reader in ready:
            return False
        if self._terminal in ready and in_foreground(self._terminal):
            return self._press()
        return True

    def _press(self) -> bool:
        """Handle one key; False at the end of the stream."""
        byte = os.read(self._terminal, 1)
        key = self._arrow() if byte == _ESCAPE else _PLAIN.get(byte)
        if key is not None and key in self._actions:
            try:
                self._actions[key]()
            except Exception as error:  # noqa: BLE001 - a key must not end the player
                self._on_error(error)
        return bool(byte)

    def _arrow(self) -> Key | None:
        """Read the rest of an escape sequence; return its arrow, None for anything else."""
        begin = self._read_soon()
        while begin == _ESCAPE:  # the previous escape was a key by itself
            begin = self._read_soon()
        if begin not in _ARROW_BEGINS:
            return None
        byte = self._read_soon()
        if byte in _ARROWS:
            return _ARROWS[byte]
        while b' ' <= byte <= b'?':  # parameters of another key's sequence
            byte = self._read_soon()
        return None

    def _read_soon(self) -> bytes:
        """Read the next byte; empty on timeout or when closed."""
        watched = [self._reader, self._terminal]
        ready, _, _ = select.select(watched, [], [], _REST_OF_ESCAPE_S)
        return os.read(self._terminal, 1) if ready == [self._terminal] else b''


def _set_again(terminal: int) -> None:
    """Set cbreak mode again after fg: a shell sets its own mode on Ctrl-Z."""
    with contextlib.suppress(termios.error):
        if termios.tcgetattr(terminal)[3] & _NOT_OURS:
            tty.setcbreak(terminal, termios.TCSANOW)


def _restore(terminal: int, attributes: list[Any]) -> None:
    """Restore the mode, only in the foreground: a background process would be stopped."""
    if in_foreground(terminal):
        with contextlib.suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(terminal, termios.TCSANOW, attributes)


def _is_our_terminal(stream: TextIO | None) -> bool:
    """Whether a stream is a terminal in the foreground; stdin may be None."""
    if stream is None or stream.closed or not stream.isatty():
        return False
    return in_foreground(stream.fileno())


def in_foreground(terminal: int) -> bool:
    """Whether this process is in the foreground; a background read would stop it."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
