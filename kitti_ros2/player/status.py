# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The status line of a player in a terminal, and its summary at the end."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from .keyboard import in_foreground
from .state import where

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import TextIO

    from .session import Session

_REFRESH_S = 0.2
_ERASE = '\r\x1b[K'
_COLUMNS = 80  # of a terminal that does not know its size
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
    """What a player writes to a terminal, and whether it reads keys from it.

    Attributes:
        say: Writes one line about what was done.
        complain: Writes one line about what could not be done.
        status: The status line; the other two hide it.
        keyboard: Whether keys control the player.
        quiet: Whether only what could not be done is written.
    """

    say: Callable[[str], None]
    complain: Callable[[str], None]
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
