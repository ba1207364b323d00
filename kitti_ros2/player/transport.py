# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Who receives what is played: the wait for subscribers, and the messages that had none."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

SETTLED_NS = 1_000_000_000
"""How long the subscriptions must be the same before it begins.

`ros2 bag record -a` looks for topics ten times a second and subscribes to what it finds one topic
after the other; the first match alone would lose what is not matched yet.
"""


class Audience(NamedTuple):
    """Who subscribes to the topics that are played.

    Attributes:
        subscribers: Nodes with a matched subscription to at least one of them.
        subscriptions: Matched subscriptions, of all topics together.
    """

    subscribers: int
    subscriptions: int


class Transport(Protocol):
    """What carries the messages of a program to its subscribers; used by one thread.

    Attributes:
        complaints: By outlet why its topic cannot be published.
    """

    @property
    def complaints(self) -> Mapping[int, str]: ...  # noqa: D102 - see above

    def look(self) -> frozenset[int]:
        """The outlets on demand that have a subscriber now."""

    def wanted(self, now_ns: int) -> frozenset[int]:
        """The same, as of the last look, unless that is old; now_ns is steady time."""

    def audience(self) -> Audience:
        """Who subscribes now."""

    def has_subscriber(self, outlet: int) -> bool:
        """Whether anybody subscribes to an outlet now."""

    def publish(self, outlet: int, data: bytes, stamp_ns: int) -> None:
        """Publish serialised data; stamp_ns is the time in the recording that it is of."""

    def make_room(self, outlet: int, seconds: float) -> bool:
        """Wait until an outlet has room for a message more; whether it has."""

    def tell_time(self, stamp_ns: int) -> None:
        """Tell the recording's time."""

    def jump(self, stamp_ns: int) -> None:
        """The position was moved to a time: what subscribers keep of another one is void."""

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until everything has arrived; the topics of what has not."""

    def close(self) -> None:
        """Take the topics away."""


class SubscriberWait:
    """Decides when to begin: enough subscribers, and none has subscribed to more for a while.

    Args:
        needed: How many subscribers; 0 does not wait.
    """

    def __init__(self, needed: int) -> None:
        self.needed = needed
        self._audience = Audience(0, 0)
        self._since_ns = 0

    def over(self, audience: Audience, now_ns: int) -> bool:
        """Whether to begin, by the audience of this moment; now_ns is steady time."""
        if audience != self._audience:
            self._audience, self._since_ns = audience, now_ns
        enough = audience.subscribers >= self.needed
        return enough and now_ns - self._since_ns >= SETTLED_NS

    def beginning(self) -> str:
        """Describe what is waited for, in a line."""
        nodes = 'a subscriber' if self.needed == 1 else f'{self.needed} subscribers'
        return f'waiting for {nodes}; --wait-for 0 begins at once'

    def ending(self) -> str:
        """Describe who came, in a line."""
        subscribers, subscriptions = self._audience
        return f'subscribers: {subscribers}, with {subscriptions} subscriptions'


class Reception:
    """Counts messages, and those that had no subscriber when they were due, by topic.

    Latched messages do not belong here: they are kept for whoever comes later.
    """

    def __init__(self) -> None:
        self._received: Counter[int] = Counter()
        self._missed: Counter[int] = Counter()

    def note(self, outlet: int, *, received: bool) -> None:
        """Count one message of an outlet."""
        (self._received if received else self._missed)[outlet] += 1

    def describe(self) -> str:
        """Describe the messages that had no subscriber, in a line; empty where all had one."""
        missed, received = dict(self._missed), dict(self._received)  # another thread counts on
        count = sum(missed.values())
        if not count:
            return ''
        total = count + sum(received.values())
        text = f'{count} of {total} messages had no subscriber (latched ones are not counted)'
        partly = sum(count for outlet, count in missed.items() if outlet in received)
        if partly:
            text += f'; {partly} of these on topics that had one at another time'
        return text
