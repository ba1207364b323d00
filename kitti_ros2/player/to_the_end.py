# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Plays on until there is nothing left to play, or somebody ends it."""

from __future__ import annotations

import gc
import sys
from contextlib import ExitStack
from typing import TYPE_CHECKING, Protocol

from .keyboard import HELP
from .keys import Controlled, player_keyboard

if TYPE_CHECKING:
    from collections.abc import Callable
    from threading import Event

    from .session import Session


class StopRequest(Protocol):
    """What the main thread of a player waits for."""

    def set(self) -> None:
        """Let the wait end; from any thread or signal handler."""

    def wait(self) -> None:
        """Wait for it."""

    def abandon(self) -> None:
        """Let the process end without what cannot be closed."""


class Player(Controlled, Protocol):
    """A player that has begun.

    Attributes:
        error: What stopped it, if anything did.
        ended: Set when everything is played.
    """

    error: BaseException | None
    ended: Event

    @property
    def session(self) -> Session: ...  # noqa: D102 - what is played


def play_to_the_end(
    player: Player, stop_request: StopRequest, say: Callable[[str], None], *, keyboard: bool
) -> int:
    """Wait until the stop_request is set, by the player or from outside.

    Args:
        player: Has begun, and sets the stop_request when everything is played.
        stop_request: Tells when to end.
        say: Told what a key did, in a line.
        keyboard: Whether the keys of a terminal control it.

    Returns:
        How much was lost, when all was played: messages that could not be made, what was missing
        from the start, and topics whose last messages did not arrive although it was lossless; 0
        when it was told to end.

    Raises:
        BaseException: What stopped the player.
    """
    with ExitStack() as stack:
        if keyboard:
            keys = stack.enter_context(player_keyboard(player, say, stop_request.set))
            if keys.listening:
                sys.stderr.write(f'{HELP}\n')
        gc.freeze()
        stop_request.wait()
        if player.error is not None:
            raise player.error
        session = player.session
        losses = session.counts.failures + len(session.program.losses)
        if session.playback.options.lossless:
            losses += len(session.late)
        return losses if player.ended.is_set() else 0
