# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The answers of a stack to the frames that it is sent: pace, latency, what is missing. No ROS.

A subscriber acknowledges a message when it is in its queue, not when it is processed, so a slow
node would lose frames of a player that only waits for acknowledgements, and its latency would be
that of the queue. Here the next frame is sent when the one before is answered. A node may answer
later than that (a synchroniser that waits for the next message) or skip frames: if no answer comes
for some time, one more frame may be on its way.
"""

from __future__ import annotations

import threading
import time
from bisect import bisect_left, insort
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_ON_THE_WAY = 10
"""Frames on their way at once, at most: the depth of the usual queue."""

_TOLERANCE_NS = 1_000_000  # stamps pass through float64 seconds, or microseconds
_LEAST_PATIENCE_NS = 2_000_000_000
_PATIENCE = 5  # times the longest latency so far
_FLOOD = 100  # messages a frame


class Answers:
    """Matches answers to frames by stamp; any thread may call it.

    Args:
        timeout_ns: Time without an answer after which none is expected, nanoseconds.
        now_ns: Steady time.

    Attributes:
        latencies_ns: By frame the time from its publishing to its first answer, nanoseconds.
        messages: Number of messages received.
        stragglers: Answers to a frame that came after the answer to a later one.
        repeated: Messages with the stamp of a frame that was answered before.
        between: Messages with a stamp between those of two frames, as of odometry at a higher rate.
        strays: Messages with any other stamp.
        first_stray_ns: The stamp of the first of them, None if it has none.
        on_the_way: The highest number of frames that were on their way at once.
        newest_ns: The last stamp that was published, nanoseconds; 0 before the first.
    """

    def __init__(self, timeout_ns: int, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._timeout_ns = timeout_ns
        self._now_ns = now_ns
        self._condition = threading.Condition()
        self._sent_ns: dict[int, int] = {}
        self._frames: dict[int, int] = {}  # by stamp
        self._stamps: list[int] = []
        self._open: list[int] = []  # sent after the last one that was answered
        self._window = 1
        self._moved_ns = 0  # the last time that a frame was sent or answered
        self._answered_ns = 0
        self.latencies_ns: dict[int, int] = {}
        self.messages = self.stragglers = self.repeated = self.between = self.strays = 0
        self.first_stray_ns: int | None = None
        self.on_the_way = 0
        self.newest_ns = 0

    def sent(self, frame: int, stamp_ns: int, *, scan: bool) -> None:
        """Note that a sample of a frame is being published.

        Args:
            frame: The frame's number.
            stamp_ns: The stamp of the message.
            scan: Whether it is the scan, from which latency counts, else from the first sample.
        """
        with self._condition:
            now = self._now_ns()
            if frame not in self._sent_ns:
                self._open.append(frame)
                self.on_the_way = max(self.on_the_way, len(self._open))
                self._moved_ns = now
            if scan or frame not in self._sent_ns:
                self._sent_ns[frame] = now
            if stamp_ns not in self._frames:
                insort(self._stamps, stamp_ns)
                self._frames[stamp_ns] = frame
            self.newest_ns = stamp_ns

    def received(self, stamp_ns: int | None) -> None:
        """Note a message of the stack.

        Args:
            stamp_ns: Its stamp; None if it has none, as an empty MarkerArray: it answers the frame
                that waits longest.
        """
        with self._condition:
            now = self._now_ns()
            self.messages += 1
            frame = self._frame_at(stamp_ns)
            if frame is None and self._is_between(stamp_ns):
                self.between += 1
                return
            if frame is None:
                self.strays += 1
                self.first_stray_ns = stamp_ns if self.strays == 1 else self.first_stray_ns
                return
            if frame in self.latencies_ns:
                self.repeated += 1
                return
            self.latencies_ns[frame] = now - self._sent_ns[frame]
            self._moved_ns = self._answered_ns = now
            if frame in self._open:
                place = self._open.index(frame)
                del self._open[: place + 1]
                if not self._open and not place:
                    self._window = 1
            else:
                self.stragglers += 1
            self._condition.notify_all()

    def may_begin(self, seconds: float) -> bool:
        """Wait until the next frame may be sent; return whether it may."""
        with self._condition:
            end = self._now_ns() + int(seconds * 1e9)
            while len(self._open) >= self._window:
                now = self._now_ns()
                until = self._moved_ns + self._patience_ns()
                if now >= until and self._window < MOST_ON_THE_WAY:
                    self._window += 1
                elif now >= end:
                    return False
                else:
                    until = end if self._window == MOST_ON_THE_WAY else min(end, until)
                    self._condition.wait((until - now) / 1e9)
        return True

    def all_in(self) -> bool:
        """Whether no answer is expected any more, after the last frame was sent."""
        with self._condition:
            return not self._open or self._now_ns() - self._moved_ns >= self._patience_ns()

    def silent(self) -> bool:
        """Whether frames are on their way, and no answer has come for the whole time limit."""
        with self._condition:
            if not self._open:
                return False
            since = max(self._answered_ns, self._sent_ns[self._open[0]])
            return self._now_ns() - since >= self._timeout_ns

    def flooded(self) -> bool:
        """Whether far more messages came than frames were sent."""
        with self._condition:
            return self.messages > _FLOOD * (10 + len(self._sent_ns))

    def frames(self) -> tuple[int, ...]:
        """Return the numbers of the frames that were sent, ascending."""
        with self._condition:
            return tuple(sorted(self._sent_ns))

    def _patience_ns(self) -> int:
        """Return how long to wait for an answer before the next frame is sent."""
        most = self._timeout_ns // 3
        if not self.latencies_ns:
            return most  # the first frame takes longest
        return min(most, max(_LEAST_PATIENCE_NS, _PATIENCE * max(self.latencies_ns.values())))

    def _is_between(self, stamp_ns: int | None) -> bool:
        inside = stamp_ns is not None and self._stamps
        return bool(inside) and self._stamps[0] < (stamp_ns or 0) < self._stamps[-1]

    def _frame_at(self, stamp_ns: int | None) -> int | None:
        if stamp_ns is None:
            return self._open[0] if self._open else None
        if stamp_ns in self._frames:
            return self._frames[stamp_ns]
        place = bisect_left(self._stamps, stamp_ns)
        near = self._stamps[max(0, place - 1) : place + 1]
        nearest = min(near, key=lambda each: abs(each - stamp_ns), default=None)
        if nearest is None or abs(nearest - stamp_ns) > _TOLERANCE_NS:
            return None
        return self._frames[nearest]
