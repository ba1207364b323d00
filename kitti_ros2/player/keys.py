# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The key bindings of a player."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from .keyboard import Key, Keyboard
from .state import where

if TYPE_CHECKING:
    from collections.abc import Callable

    from .playback import Playback

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

    def tell_state(self) -> None:
        """Publish the changed state."""


def player_keyboard(
    player: Controlled,
    say: Callable[[str], None],
    complain: Callable[[str], None],
    quit_now: Callable[[], None],
) -> Keyboard:
    """Create the keyboard with the keys of keyboard.HELP.

    Args:
        player: The controlled player.
        say: Called with one line that describes what a key did.
        complain: Called with the reason why a key had no effect.
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
            player.tell_state()
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
        on_error=lambda error: complain(str(error)),
    )
