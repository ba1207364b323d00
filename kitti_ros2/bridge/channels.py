# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A program's topics as channels of the WebSocket server: CDR with its ros2msg definition.

What is latched is kept and given to each new subscriber, as a transient local publisher does.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING

from foxglove import Channel, Schema

from ..messages.diagnostics import DIAGNOSTICS
from ..messages.ros_types import TYPESTORE
from ..player.program import Outlet
from ..player.source import STATE
from ..player.transport import Audience

if TYPE_CHECKING:
    from collections.abc import Callable

    from foxglove import Context

    from ..messages.ros_types import Typestore
    from ..player.program import Program

_LOOK_EVERY_NS = 50_000_000
_RENEW_AFTER_NS = 100_000_000
_LAST_WAIT_S = 0.3


class ViewerChannels:
    """The channels of a program, and one for the player's state; the Transport of a session.

    Args:
        program: Whose topics.
        context: Connects them with a server.
        tell_time: Tells viewers the recording's time, nanoseconds since 1970.
        tell_jump: Tells viewers that time was moved, and where to.

    Attributes:
        complaints: None: every type is described by its own definition.
    """

    def __init__(
        self,
        program: Program,
        context: Context,
        tell_time: Callable[[int], None],
        tell_jump: Callable[[int], None],
    ) -> None:
        self.complaints: dict[int, str] = {}
        self.tell_time = tell_time
        self._tell_jump = tell_jump
        self._outlets = list(program.outlets)
        self._channels = [_open(each, program.typestore, context) for each in self._outlets]
        self._state = len(self._outlets)
        state = Outlet(STATE, DIAGNOSTICS, latched=True, depth=1)
        self._outlets.append(state)
        self._channels.append(_open(state, TYPESTORE, context))
        self._index = {each.name: index for index, each in enumerate(self._outlets)}
        self._large = [index for index, each in enumerate(self._outlets) if each.on_demand]
        self._lock = threading.Lock()
        self._kept: dict[int, deque[tuple[bytes, int]]] = {
            index: deque(maxlen=each.depth)
            for index, each in enumerate(self._outlets)
            if each.latched
        }
        self._wanted: frozenset[int] = frozenset()
        self._looked_ns = 0
        self._renew_ns: int | None = None

    def wanted(self, now_ns: int) -> frozenset[int]:
        """The outlets on demand with a subscriber; looked up when the last look is old."""
        if now_ns - self._looked_ns > _LOOK_EVERY_NS:
            self.look()
        return self._wanted

    def look(self) -> frozenset[int]:
        """The outlets on demand with a subscriber now."""
        self._looked_ns = time.monotonic_ns()
        if self._renew_ns is not None and self._looked_ns >= self._renew_ns:
            self._renew()
        self._wanted = frozenset(
            index for index in self._large if self._channels[index].has_sinks()
        )
        return self._wanted

    def audience(self) -> Audience:
        """How many channels have a viewer: the server tells channels, not viewers."""
        watched = sum(channel.has_sinks() for channel in self._channels)
        return Audience(int(watched > 0), watched)

    def has_subscriber(self, outlet: int) -> bool:
        """Whether a viewer subscribes to an outlet."""
        return bool(self._channels[outlet].has_sinks())

    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data."""
        kept = self._kept.get(outlet)
        if kept is not None:
            with self._lock:
                kept.append((data, stamp_ns))
            if self._renew_ns is not None:
                return
        self._channels[outlet].log(data, log_time=stamp_ns)

    def publish_state(self, data: bytes, stamp_ns: int) -> None:
        """Publish a DiagnosticArray on the channel STATE."""
        with self._lock:
            self._kept[self._state].append((data, stamp_ns))
        self._channels[self._state].log(data, log_time=stamp_ns)

    def subscribed(self, topic: str) -> None:
        """Somebody has subscribed to a topic: look again, and give what is kept; from any thread.

        Other subscribers get it once more, for the server cannot address one of them.
        """
        self._looked_ns = 0
        outlet = self._index.get(topic)
        if outlet is not None:
            self._give(outlet)

    def make_room(self, outlet: int, seconds: float) -> bool:  # noqa: ARG002 - see Transport
        """Whether there is room: always, a slow viewer loses its oldest messages."""
        return True

    def jump(self, stamp_ns: int) -> None:
        """Tell viewers, who forget what they have; a moment later what is latched is renewed.

        News of a jump and messages have a queue each, so that either may arrive first.
        """
        with self._lock:
            for outlet, kept in self._kept.items():
                if outlet != self._state:
                    kept.clear()
        if self._renew_ns is None:
            self._renew_ns = time.monotonic_ns() + _RENEW_AFTER_NS
        self._tell_jump(stamp_ns)

    def _renew(self) -> None:
        self._renew_ns = None
        for outlet in self._kept:
            self._give(outlet)

    def _give(self, outlet: int) -> None:
        with self._lock:
            kept = list(self._kept.get(outlet, ()))
        for data, stamp_ns in kept:
            self._channels[outlet].log(data, log_time=stamp_ns)

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Give viewers time to receive what is queued; the server does not say when they have."""
        if self._renew_ns is not None:
            self._renew()
        if any(channel.has_sinks() for channel in self._channels):
            time.sleep(min(seconds, _LAST_WAIT_S))
        return ()

    def close(self) -> None:
        """Take the channels away."""
        for channel in self._channels:
            channel.close()


def _open(outlet: Outlet, typestore: Typestore, context: Context) -> Channel:
    """A channel with the schema that a bag has for its topic."""
    text, _ = typestore.generate_msgdef(outlet.msgtype, ros_version=2)
    schema = Schema(name=outlet.msgtype, encoding='ros2msg', data=text.encode())
    return Channel(outlet.name, message_encoding='cdr', schema=schema, context=context)
