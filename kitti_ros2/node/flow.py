# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Flow control: a publisher waits for acknowledgements before its queue overwrites a message."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import ReliabilityPolicy

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.publisher import Publisher

_SLOW_NS = 1_000_000_000
_STALLED_NS = 5_000_000_000
_SAY_EVERY_S = 10.0


class FlowControl:
    """Bounds the unacknowledged messages of reliable publishers; best-effort ones have no bound.

    The middleware only reports whether all messages of a publisher are acknowledged.

    Args:
        publishers: By outlet.
        logger: An rclpy logger; warns about slow subscribers and about those that may have stopped.
        now_ns: Steady time.
    """

    def __init__(
        self,
        publishers: Mapping[int, Publisher],
        logger: Any,  # noqa: ANN401 - rclpy has no types
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._publishers = publishers
        self._logger = logger
        self._now_ns = now_ns
        self._window = {
            outlet: max(1, publisher.qos_profile.depth - 1)
            for outlet, publisher in publishers.items()
            if publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
        }
        self._unacknowledged = dict.fromkeys(self._window, 0)
        self._waiting_since: dict[int, int] = {}

    def make_room(self, outlet: int, seconds: float) -> bool:
        """Wait until the queue of an outlet has room for one message; return whether it has."""
        window = self._window.get(outlet)
        if window is None:
            return True
        if self._unacknowledged[outlet] >= window:
            since_ns = self._waiting_since.setdefault(outlet, self._now_ns())
            arrived = self._arrived(outlet, seconds)
            self._say(outlet, self._now_ns() - since_ns, arrived=arrived)
            if not arrived:
                return False
            del self._waiting_since[outlet]
            self._unacknowledged[outlet] = 0
        self._unacknowledged[outlet] += 1
        return True

    def finish(self, seconds: float) -> tuple[str, ...]:
        """Wait until every message is acknowledged; return the topics where one is not."""
        end_ns = self._now_ns() + int(seconds * 1e9)
        return tuple(
            self._publishers[outlet].topic_name
            for outlet in self._window
            if not self._arrived(outlet, max(0.0, (end_ns - self._now_ns()) / 1e9))
        )

    def _arrived(self, outlet: int, seconds: float) -> bool:
        arrived: bool = self._publishers[outlet].wait_for_all_acked(Duration(seconds=seconds))
        return arrived

    def _say(self, outlet: int, waited_ns: int, *, arrived: bool) -> None:
        name = self._publishers[outlet].topic_name
        count = self._unacknowledged[outlet]
        seconds = waited_ns / 1e9
        # Two calls: rclpy throttles each line of code separately.
        if arrived and waited_ns >= _SLOW_NS:
            text = f'{name}: slow subscriber, {seconds:.1f} s to acknowledge {count} messages'
            self._logger.warning(text, throttle_duration_sec=_SAY_EVERY_S)
        elif not arrived and waited_ns >= _STALLED_NS:
            text = (
                f'{name}: the last {count} messages are not all acknowledged after {seconds:.0f} s;'
                f' a subscriber may have stopped'
            )
            self._logger.warning(text, throttle_duration_sec=_SAY_EVERY_S)
