# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a program as WebSocket channels: CDR with its ros2msg definition.

Latched messages are kept and sent to each new subscriber, like a transient local publisher does.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING

import foxglove

from ..messages.ros_types import TYPESTORE
from ..model.channels import Channel
from ..model.msgtypes import DIAGNOSTICS
from ..player.source import STATE
from ..player.transport import Audience, Transport

if TYPE_CHECKING:
    from collections.abc import Callable

    from foxglove import Context

    from ..messages.ros_types import Typestore
    from ..player.program import Program

_RENEW_AFTER_NS = 100_000_000
_LAST_WAIT_S = 0.3


class ViewerChannels(Transport):
    """The Transport of a session: a channel per topic, and one for the player's state.

    There are no complaints: every type comes with its own definition. There is always room: a slow
    viewer loses its oldest messages.

    Args:
        program: The program with the topics.
        context: Connects the channels with a server.
        tell_time: Sends the recording's time to viewers, nanoseconds since 1970.
        tell_jump: Sends the target of a seek to viewers.
    """

    def __init__(
        self,
        program: Program,
        context: Context,
        tell_time: Callable[[int], None],
        tell_jump: Callable[[int], None],
    ) -> None:
        state = Channel(STATE, DIAGNOSTICS, latched=True, depth=1)
        super().__init__([*program.channels, state])
        self._tell_time = tell_time
        self._tell_jump = tell_jump
        self._channels = [_open(each, program.typestore, context) for each in program.channels]
        self._channels.append(_open(state, TYPESTORE, context))
        self._state = len(program.channels)
        self._index = {each.topic: index for index, each in enumerate(self.channels)}
        self._lock = threading.Lock()
        self._kept: dict[int, deque[tuple[bytes, int]]] = {
            index: deque(maxlen=each.depth)
            for index, each in enumerate(self.channels)
            if each.latched
        }
        self._renew_ns: int | None = None

    def look(self) -> frozenset[int]:
        """Return the on-demand outlets with a subscriber now; resend what a seek left to send."""
        if self._renew_ns is not None and time.monotonic_ns() >= self._renew_ns:
            self._renew()
        return super().look()

    def audience(self) -> Audience:
        """Count the channels with a viewer; the server does not count viewers."""
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
        """Handle a new subscription: look again, and send latched messages; from any thread.

        Other subscribers receive them again: the server cannot address a single one.
        """
        self._looked_ns = 0
        outlet = self._index.get(topic)
        if outlet is not None:
            self._give(outlet)

    def tell_time(self, stamp_ns: int) -> None:
        """Send the recording's time."""
        self._tell_time(stamp_ns)

    def jump(self, stamp_ns: int) -> None:
        """Tell viewers, which then drop their messages; resend latched ones after a short delay.

        Seeks and messages have separate queues, so that either may arrive first.
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
        """Wait a fixed time for queued messages; the server does not report their delivery."""
        if self._renew_ns is not None:
            self._renew()
        if any(channel.has_sinks() for channel in self._channels):
            time.sleep(min(seconds, _LAST_WAIT_S))
        return ()

    def close(self) -> None:
        """Remove the channels."""
        for channel in self._channels:
            channel.close()


def _open(channel: Channel, typestore: Typestore, context: Context) -> foxglove.Channel:
    """Open a viewer's channel with the same schema that a bag has for the topic."""
    text, _ = typestore.generate_msgdef(channel.msgtype, ros_version=2)
    schema = foxglove.Schema(name=channel.msgtype, encoding='ros2msg', data=text.encode())
    return foxglove.Channel(channel.topic, message_encoding='cdr', schema=schema, context=context)
