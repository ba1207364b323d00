# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's services: those of rosbag2 if rosbag2_interfaces is installed, else std_srvs.

Intended differences from rosbag2 (rosbag2_transport/player.cpp, 0.26):

- play_next plays whole frames (parameter step; 0 is one sample), rosbag2 one message. Both answer
  false while not paused, and at the end.
- burst plays whole samples, so possibly a few messages more than requested, rosbag2 exact numbers.
  For both 0 means all that remain, and both play nothing while not paused.
- seek past the last stamp fails: success is false, and the position stays. rosbag2 always answers
  true; nothing remains then, so that its playback ends or loops. Before the first stamp both go to
  the beginning.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from std_srvs.srv import Trigger

from ..model.errors import UsageError
from ..player.state import where

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from rclpy.node import Node

    from ..player.keys import Controlled
    from ..player.playback import Playback

_PACKAGE = 'rosbag2_interfaces'


def create_services(node: Node, player: Controlled) -> None:
    """Create ~/pause and the other services, with the installed types."""
    types = _rosbag2_types()
    make = _rosbag2_services if types else _plain_services
    for name, kind, handler in make(player, types):
        node.create_service(kind, f'~/{name}', handler)


def _rosbag2_types() -> ModuleType | None:
    try:
        return import_module(f'{_PACKAGE}.srv')
    except ImportError:
        return None


def _plain_services(player: Controlled, types: ModuleType | None) -> Any:  # noqa: ANN401, ARG001
    """List the services as Triggers, which describe their result in words."""

    def handler(act: Callable[[Playback], tuple[bool, str]]) -> Callable[[Any, Any], Any]:
        def handle(_: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
            response.success, response.message = act(player.playback)
            player.tell_state()
            return response

        return handle

    return [
        ('pause', Trigger, handler(_pause)),
        ('resume', Trigger, handler(_resume)),
        ('toggle_paused', Trigger, handler(_toggle)),
        ('play_next', Trigger, handler(_play_next)),
        ('stop', Trigger, handler(_stop)),
    ]


def _pause(playback: Playback) -> tuple[bool, str]:
    playback.pause()
    return True, where(playback)


def _resume(playback: Playback) -> tuple[bool, str]:
    playback.resume()
    return True, where(playback)


def _toggle(playback: Playback) -> tuple[bool, str]:
    playback.toggle_paused()
    return True, where(playback)


def _play_next(playback: Playback) -> tuple[bool, str]:
    if playback.play_next():
        return True, where(playback)
    state = playback.state()
    if not state.paused:
        return False, 'time runs; pause first'
    return False, 'there is nothing left to play' if state.finished else 'it took too long'


def _stop(playback: Playback) -> tuple[bool, str]:
    playback.stop()
    return True, 'stopped'


def _rosbag2_services(player: Controlled, types: ModuleType | None) -> Any:  # noqa: ANN401
    """List the services of rosbag2's player; the module's docstring lists the differences."""

    def handler(act: Callable[[Any, Any], object]) -> Callable[[Any, Any], Any]:
        def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
            act(request, response)
            player.tell_state()
            return response

        return handle

    def is_paused(_: Any, response: Any) -> None:  # noqa: ANN401
        response.paused = player.playback.state().paused

    def get_rate(_: Any, response: Any) -> None:  # noqa: ANN401
        response.rate = player.playback.state().rate

    def set_rate(request: Any, response: Any) -> None:  # noqa: ANN401
        response.success = _succeeds(lambda: player.set_rate(request.rate))

    def play_next(_: Any, response: Any) -> None:  # noqa: ANN401
        response.success = player.playback.play_next()

    def burst(request: Any, response: Any) -> None:  # noqa: ANN401
        response.actually_burst = player.playback.burst(request.num_messages)

    def seek(request: Any, response: Any) -> None:  # noqa: ANN401
        stamp_ns = request.time.sec * 1_000_000_000 + request.time.nanosec
        response.success = _succeeds(lambda: player.playback.seek(stamp_ns))

    acts = {
        'Pause': lambda *_: player.playback.pause(),
        'Resume': lambda *_: player.playback.resume(),
        'TogglePaused': lambda *_: player.playback.toggle_paused(),
        'IsPaused': is_paused,
        'GetRate': get_rate,
        'SetRate': set_rate,
        'PlayNext': play_next,
        'Burst': burst,
        'Seek': seek,
        'Stop': lambda *_: player.playback.stop(),
    }
    return [(_snake(name), getattr(types, name), handler(act)) for name, act in acts.items()]


def _snake(name: str) -> str:
    """Convert TogglePaused to toggle_paused."""
    return ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')


def _succeeds(act: Callable[[], None]) -> bool:
    try:
        act()
    except UsageError:
        return False
    return True
