# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player's services: those of rosbag2 if rosbag2_interfaces is installed, else std_srvs.

Intended differences from rosbag2 (rosbag2_transport/player.cpp, 0.26):

- play_next plays whole frames (parameter step; 0 is one sample), rosbag2 one message. Both answer
  false while not paused, and at the end.
- burst plays whole samples, so possibly a few messages more than requested, rosbag2 exact
  numbers. For both 0 means all that remain, and both play nothing while not paused.
- seek past the last stamp fails: success is false, and the position stays. rosbag2 always answers
  true; nothing remains then, so that its playback ends or loops. Before the first stamp both go
  to the beginning.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias

from std_srvs.srv import Trigger

from ..model.errors import UsageError
from ..model.stamps import from_sec_nanosec
from ..player.state import where

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from rclpy.node import Node

    from ..player.keys import Controlled
    from ..player.playback import Playback

Act: TypeAlias = 'Callable[[Any, Any], object]'
"""A handler of a request, which fills in the response."""

_PACKAGE = 'rosbag2_interfaces'


def create_services(node: Node, player: Controlled) -> None:
    """Create ~/pause and the other services, with the installed types."""
    types = _rosbag2_types()
    services = rosbag2_services(player, types) if types else plain_services(player)
    for name, (kind, act) in services.items():
        node.create_service(kind, f'~/{name}', _handler(player, act))


def _rosbag2_types() -> ModuleType | None:
    try:
        return import_module(f'{_PACKAGE}.srv')
    except ImportError:
        return None


def _handler(player: Controlled, act: Act) -> Callable[[Any, Any], Any]:
    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        act(request, response)
        player.tell_state()
        return response

    return handle


def plain_services(player: Controlled) -> dict[str, tuple[Any, Act]]:
    """Return type and handler by name: Triggers, which describe their result in words."""

    def control(name: str) -> Act:
        def act(_: Any, response: Any) -> None:  # noqa: ANN401
            getattr(player.playback, name)()
            response.success, response.message = True, where(player.playback)

        return act

    def play_next(_: Any, response: Any) -> None:  # noqa: ANN401
        response.success, response.message = _play_next(player.playback)

    def stop(_: Any, response: Any) -> None:  # noqa: ANN401
        player.playback.stop()
        response.success, response.message = True, 'stopped'

    acts = {name: control(name) for name in ('pause', 'resume', 'toggle_paused')}
    acts |= {'play_next': play_next, 'stop': stop}
    return {name: (Trigger, act) for name, act in acts.items()}


def _play_next(playback: Playback) -> tuple[bool, str]:
    if playback.play_next():
        return True, where(playback)
    state = playback.state()
    if not state.paused:
        return False, 'time runs; pause first'
    return False, 'there is nothing left to play' if state.finished else 'it took too long'


def rosbag2_services(player: Controlled, types: ModuleType) -> dict[str, tuple[Any, Act]]:
    """Return type and handler by name, as in rosbag2; see the module's docstring."""

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
        stamp_ns = from_sec_nanosec(request.time.sec, request.time.nanosec)
        response.success = _succeeds(lambda: player.playback.seek(stamp_ns))

    acts: dict[str, Act] = {
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
    return {_snake(name): (getattr(types, name), act) for name, act in acts.items()}


def _snake(name: str) -> str:
    """Convert TogglePaused to toggle_paused."""
    return ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')


def _succeeds(act: Callable[[], None]) -> bool:
    try:
        act()
    except UsageError:
        return False
    return True
