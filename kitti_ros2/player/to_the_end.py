# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a player until everything is played or a stop is requested."""

from __future__ import annotations

import gc
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Protocol

from .keyboard import HELP
from .keys import Controlled, player_keyboard
from .status import describe_now, describe_result

if TYPE_CHECKING:
    from threading import Event

    from .session import Session
    from .status import Terminal


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
    with ExitStack() as stack:
        if terminal.keyboard:
            tell = (lambda _: status.draw()) if status.shown else say
            keys = stack.enter_context(
                player_keyboard(player, tell, terminal.complain, stop_request.set)
            )
            if keys.listening and not terminal.quiet:
                sys.stderr.write(f'{HELP}\n')
        stack.enter_context(status.follow(lambda: describe_now(player.session)))
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
