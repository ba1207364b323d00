# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The interface between a session and its middleware or server, and statistics of subscribers."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.channels import Channel

SETTLED_NS = 1_000_000_000
"""How long the subscriptions must stay unchanged before playback begins.

`ros2 bag record -a` looks for topics ten times a second and subscribes to them one by one;
starting at the first match would lose messages of topics that are not matched yet.
"""

_LOOK_EVERY_NS = 50_000_000


class Audience(NamedTuple):
    """The subscribers of the topics that are played.

    Attributes:
        subscribers: Nodes with a matched subscription to at least one of the topics.
        subscriptions: Matched subscriptions of all topics.
    """

    subscribers: int
    subscriptions: int


class Transport(ABC):
    """The carrier of the messages of a program: a middleware or a server; used by one thread.

    Args:
        channels: The topics.

    Attributes:
        channels: The topics.
        complaints: Channels that cannot be published, with the reason.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self.channels = channels
        self.complaints: dict[int, str] = {}
        self._wanted: frozenset[int] = frozenset()
        self._looked_ns = 0

    def look(self) -> frozenset[int]:
        """Return the on-demand outlets that have a subscriber now."""
        self._looked_ns = time.monotonic_ns()
        self._wanted = frozenset(
            index
            for index, each in enumerate(self.channels)
            if each.on_demand and index not in self.complaints and self.has_subscriber(index)
        )
        return self._wanted

    def wanted(self, now_ns: int) -> frozenset[int]:
        """Return the same, cached for a short time; now_ns is steady time."""
        if now_ns - self._looked_ns > _LOOK_EVERY_NS:
            self.look()
        return self._wanted

    @abstractmethod
    def audience(self) -> Audience:
        """Count the current subscribers."""

    @abstractmethod
    def has_subscriber(self, outlet: int) -> bool:
        """Whether an outlet has a subscriber now."""

    @abstractmethod
    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data; stamp_ns is its time in the recording."""

    def make_room(self, outlet: int, seconds: float) -> bool:  # noqa: ARG002 - always room here
        """Wait until an outlet has room for one more message; return whether it has."""
        return True

    def may_begin(self, frame: int, seconds: float) -> bool:  # noqa: ARG002 - always here
        """Wait until the messages of a frame may be published, in lossless mode; return whether."""
        return True

    @abstractmethod
    def tell_time(self, stamp_ns: int) -> None:
        """Publish the recording's time."""

    def jump(self, stamp_ns: int) -> None:  # noqa: B027 - subscribers may notice it themselves
        """Announce a seek to a time: what subscribers hold of another time is outdated."""

    @abstractmethod
    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until all messages have arrived; return the topics whose messages have not."""

    @abstractmethod
    def close(self) -> None:
        """Remove the topics."""


class SubscriberWait:
    """Decides when to begin: enough subscribers, and no new subscription for SETTLED_NS.

    Args:
        needed: Number of subscribers; 0 does not wait.
    """

    def __init__(self, needed: int) -> None:
        self.needed = needed
        self._audience = Audience(0, 0)
        self._since_ns = 0

    def over(self, audience: Audience, now_ns: int) -> bool:
        """Whether to begin, given the current audience; now_ns is steady time."""
        if audience != self._audience:
            self._audience, self._since_ns = audience, now_ns
        enough = audience.subscribers >= self.needed
        return enough and now_ns - self._since_ns >= SETTLED_NS

    def beginning(self) -> str:
        """Return the message shown when the wait begins, one line."""
        nodes = 'a subscriber' if self.needed == 1 else f'{self.needed} subscribers'
        return f'waiting for {nodes}; --wait-for 0 starts at once'

    def ending(self) -> str:
        """Return the message shown when the wait ends, one line."""
        subscribers, subscriptions = self._audience
        return f'subscribers: {subscribers}, with {subscriptions} subscriptions'


class Reception:
    """Counts messages with and without a subscriber at the time they were due, by topic.

    Latched messages are not counted: late subscribers receive them.
    """

    def __init__(self) -> None:
        self._received: Counter[int] = Counter()
        self._missed: Counter[int] = Counter()

    def note(self, outlet: int, *, received: bool) -> None:
        """Count one message of an outlet."""
        (self._received if received else self._missed)[outlet] += 1

    def describe(self) -> str:
        """Describe the messages without a subscriber in one line; empty if all had one."""
        missed, received = dict(self._missed), dict(self._received)  # another thread keeps counting
        count = sum(missed.values())
        if not count:
            return ''
        total = count + sum(received.values())
        text = f'{count} of {total} messages had no subscriber (latched ones are not counted)'
        partly = sum(count for outlet, count in missed.items() if outlet in received)
        if partly:
            text += f'; {partly} of these on topics that had one at another time'
        return text
