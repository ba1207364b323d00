# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a session needs of the carrier of its messages: a middleware, or a server for viewers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .audience import Audience


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
