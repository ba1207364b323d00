# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A player in a terminal: run to the end, with keys and a status line."""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import sys
import termios
import threading
import time
import tty
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

from ..model.errors import UsageError
from .session import where

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from threading import Event
    from typing import TextIO

    from typing_extensions import Self

    from .playback import Playback
    from .session import Session


# Keyboard input in a terminal; the keys are those of `ros2 bag play`.

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
_POLL_S = 0.5
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
        """True if keys are handled."""
        return self._thread is not None

    def __enter__(self) -> Self:
        stream = sys.stdin if self._stream is None else self._stream
        if _is_our_terminal(stream):
            # Completed steps are undone if a later one fails.
            with contextlib.ExitStack() as exit_stack:
                self._open(stream.fileno(), exit_stack)
                self._closing = exit_stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    def _open(self, terminal: int, exit_stack: contextlib.ExitStack) -> None:
        self._terminal = terminal
        self._reader, writer = os.pipe()
        exit_stack.callback(os.close, self._reader)
        exit_stack.callback(os.close, writer)
        attributes = termios.tcgetattr(terminal)
        exit_stack.callback(_restore, terminal, attributes)
        if threading.current_thread() is threading.main_thread():
            self._restore_at_signals(attributes, exit_stack)
        tty.setcbreak(terminal, termios.TCSANOW)
        self._thread = threading.Thread(target=self._listen, name='keyboard', daemon=True)
        self._thread.start()
        exit_stack.callback(self._thread.join)
        exit_stack.callback(os.write, writer, b'.')

    def _restore_at_signals(self, attributes: list[Any], exit_stack: contextlib.ExitStack) -> None:
        """Restore the mode before a signal ends the process, such as that of Ctrl-Backslash."""

        def end(number: int, _: object) -> None:
            with self._mode:
                self._over = True
                _restore(self._terminal, attributes)
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)

        for number in _DEADLY:
            if signal.getsignal(number) is signal.SIG_DFL:
                exit_stack.callback(signal.signal, number, signal.SIG_DFL)
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
        ready, _, _ = select.select(watched, [], [], _POLL_S)
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
    """Return whether a stream is a terminal in the foreground; stdin may be None."""
    if stream is None or stream.closed or not stream.isatty():
        return False
    return in_foreground(stream.fileno())


def in_foreground(terminal: int) -> bool:
    """Return whether this process is in the foreground; a background read would stop it."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False


# The key bindings of a player.

_RATE_STEP = 0.1


class Controlled(Protocol):
    """A player that keys and services control.

    Attributes:
        playback: The controls of what is played now.
    """

    @property
    def playback(self) -> Playback: ...  # noqa: D102 - see above

    def set_rate(self, rate: float) -> None:
        """Set the rate; UsageError if it is out of range."""

    def publish_state(self) -> None:
        """Publish the changed state."""


def player_keyboard(
    player: Controlled,
    say: Callable[[str], None],
    warn: Callable[[str], None],
    quit_now: Callable[[], None],
) -> Keyboard:
    """Create the keyboard with the keys of keyboard.HELP.

    Args:
        player: The controlled player.
        say: Called with one line that describes what a key did.
        warn: Called with the reason why a key had no effect.
        quit_now: The handler of q.
    """

    def faster(sign: int) -> None:
        rate = player.playback.state().rate
        player.set_rate(rate * (1 + sign * _RATE_STEP))
        say(f'rate {player.playback.state().rate:.2f}')

    def control(name: str) -> Callable[[], None]:
        """Return a handler that controls what is played when the key is pressed."""

        def act() -> None:
            getattr(player.playback, name)()
            player.publish_state()
            say(where(player.playback))

        return act

    return Keyboard(
        {
            Key.SPACE: control('toggle_paused'),
            Key.RIGHT: control('play_next'),
            Key.LEFT: control('play_previous'),
            Key.UP: lambda: faster(1),
            Key.DOWN: lambda: faster(-1),
            Key.QUIT: quit_now,
        },
        on_error=lambda error: warn(str(error)),
    )


# The status line of a player in a terminal, and its summary at the end.

_REFRESH_S = 0.2
_ERASE = '\r\x1b[K'
_COLUMNS = 80  # of a terminal without a known size
_LISTED = 3


class StatusLine:
    """One line at the bottom of a terminal, written again and again in its place.

    Whatever else is written to the terminal calls hide before. The cursor stays at the beginning of
    the line, so that a log line of another library replaces it.

    Args:
        stream: The terminal; None for standard error.
        show: Whether to show it, if the stream is a terminal.
    """

    def __init__(self, stream: TextIO | None = None, *, show: bool = True) -> None:
        self._stream = sys.stderr if stream is None else stream
        self.shown = show and self._stream.isatty()
        self._text: Callable[[], str] | None = None
        self._drawn = ''
        self._lock = threading.Lock()
        self._over = threading.Event()

    @contextmanager
    def follow(self, text: Callable[[], str]) -> Iterator[None]:
        """Show a text, asking for it several times a second, until the end of the context."""
        if not self.shown:
            yield
            return
        self._text = text
        thread = threading.Thread(target=self._refresh, name='status', daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._over.set()
            thread.join()
            self._text = None
            self.hide()

    def draw(self) -> None:
        """Write the line as it is now."""
        if self._text is None or not in_foreground(self._stream.fileno()):
            return
        # The terminal may be gone, or the session be replaced by that of another source.
        with self._lock, suppress(OSError, UsageError):
            columns = os.get_terminal_size(self._stream.fileno()).columns or _COLUMNS
            text = self._text()[: columns - 1]
            if text != self._drawn:
                self._stream.write(f'{_ERASE}{text}\r')
                self._stream.flush()
                self._drawn = text

    def hide(self) -> None:
        """Erase the line, to write something else in its place."""
        with self._lock, suppress(OSError):
            if self._drawn:
                self._stream.write(_ERASE)
                self._stream.flush()
                self._drawn = ''

    def _refresh(self) -> None:
        while not self._over.wait(_REFRESH_S):
            self.draw()


@dataclass(frozen=True)
class Terminal:
    """The output of a player to a terminal, and its keyboard.

    Attributes:
        say: Writes one line about what was done.
        warn: Writes one line about what could not be done.
        status: The status line; the other two hide it.
        keyboard: Whether keys control the player.
        quiet: Whether only what could not be done is written.
    """

    say: Callable[[str], None]
    warn: Callable[[str], None]
    status: StatusLine
    keyboard: bool = True
    quiet: bool = False


def describe_now(session: Session) -> str:
    """Return the status of a session, such as 'playing, frame 5 of 0-119, 0.52 s, rate 1.00'."""
    state, frames = session.playback.state(), session.program.frames
    return (
        f'{where(session.playback)} of {frames.min()}-{frames.max()},'
        f' {state.offset_ns / 1e9:.2f} s, rate {state.rate:.2f}, dropped {session.counts.failures}'
    )


def describe_result(session: Session, seconds: float, *, ended: bool) -> str:
    """Return what a session has played and dropped, in one line.

    Args:
        session: The session.
        seconds: How long it has played, of real time.
        ended: Whether everything was played.
    """
    counts = session.counts
    text = 'played' if ended else f'stopped at frame {session.playback.state().frame}, after'
    text += f' {counts.frames} frames, {counts.messages} messages in {seconds:.1f} s; '
    if not counts.failures:
        return f'{text}none dropped'
    reasons = [f'{reason} ({count})' for reason, count in counts.dropped.items() if count]
    rest = len(reasons) - _LISTED
    more = f'; and {rest} more reasons, listed above' * (rest > 0)
    return f'{text}{counts.failures} dropped: {"; ".join(reasons[:_LISTED])}{more}'


# Runs a player until everything is played or a stop is requested.


class StopRequest(Protocol):
    """A request to stop; the main thread of a player waits for it."""

    def set(self) -> None:
        """Request the stop; from any thread or signal handler."""

    def wait(self) -> None:
        """Wait until the stop is requested."""

    def abandon(self) -> None:
        """Let the process exit even though something cannot be closed."""


class Player(Controlled, Protocol):
    """A started player.

    Attributes:
        error: The error that stopped it, if any.
        ended: Set when everything is played.
    """

    error: BaseException | None
    ended: Event

    @property
    def session(self) -> Session: ...  # noqa: D102 - see Session


def play_to_the_end(player: Player, stop_request: StopRequest, terminal: Terminal) -> int:
    """Wait until a stop is requested, by the player or from outside.

    Args:
        player: A started player, which requests the stop when everything is played.
        stop_request: The request to wait for.
        terminal: Shows the status, what a key did, and a summary at the end.

    Returns:
        The number of losses if everything was played: messages that could not be made, data missing
        from the start, and topics whose last messages did not arrive in lossless mode; 0 if a stop
        was requested.

    Raises:
        BaseException: The error that stopped the player.
    """
    status, say = terminal.status, terminal.say
    started = time.monotonic()
    with ExitStack() as exit_stack:
        if terminal.keyboard:
            report = (lambda _: status.draw()) if status.shown else say
            keys = exit_stack.enter_context(
                player_keyboard(player, report, terminal.warn, stop_request.set)
            )
            if keys.listening and not terminal.quiet:
                sys.stderr.write(f'{HELP}\n')
        exit_stack.enter_context(status.follow(lambda: describe_now(player.session)))
        gc.freeze()
        stop_request.wait()
    if player.error is not None:
        raise player.error
    session = player.session
    if session.counts.frames and not terminal.quiet:
        say(describe_result(session, time.monotonic() - started, ended=player.ended.is_set()))
    losses = session.counts.failures + len(session.program.losses)
    if session.playback.options.lossless:
        losses += len(session.late)
    return losses if player.ended.is_set() else 0
