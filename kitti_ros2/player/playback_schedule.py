# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The schedule of a playback: which event is due when. No ROS, no disk."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from ..options.playback import AtEnd
from .playback_events import Idle, Jump, Send, SteadyClock, Tick

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.samples import Int64Array
    from ..options.playback import PlaybackOptions
    from .playback_events import Event

_SECOND = 1_000_000_000
_LONG_WAIT_NS = 4_000_000
_IDLE_EVERY_NS = 50_000_000
"""During a long wait other work may run: at its beginning, and at this interval."""


class PlaybackSchedule:
    """Schedules positions 0 .. N-1 in time; Playback adds the controls.

    Args:
        stamps_ns: (N,) int64 nanoseconds, ascending; N > 0.
        frames: (N,) int64 frame numbers, each frame in one piece.
        options: Playback options.
        clock: Steady time.
        longest_gap_ns: The recording's time skips ahead where the next sample is later than this.
    """

    def __init__(
        self,
        stamps_ns: Int64Array,
        frames: Int64Array,
        options: PlaybackOptions,
        clock: SteadyClock | None = None,
        longest_gap_ns: int | None = None,
    ) -> None:
        self._stamps: list[int] = stamps_ns.tolist()
        self._longest_gap_ns = longest_gap_ns
        _, first = np.unique(frames, return_index=True)
        starts = np.sort(first)
        self._frame_numbers: list[int] = frames[starts].tolist()
        self._frame_starts: list[int] = starts.tolist()
        self._options = options
        self._clock = clock or SteadyClock()
        self._condition = threading.Condition()
        self._position = 0
        self._completed = 0
        self._paused = options.start_paused
        self._waiting = options.subscribers > 0
        self._stopped = False
        self._round = 1
        self._rush_until = 0
        self._burst_left = 0
        self._burst_sent = 0
        self._jump = False
        # Time stands still before the start, and from a jump until it is handled.
        self._is_held = True
        self._next_idle = 0
        now = self._clock.now_ns()
        self._begin_ns: int = now + options.delay_ns
        self._anchor_ns: int = self._begin_ns
        self._anchor_stamp: int = self._stamps[0]
        self._next_tick = now

    def events(self) -> Iterator[Event]:
        """Yield each event when it is due, until all is played or playback is stopped.

        After a jump, time goes on when the caller asks for the next event.
        """
        with self._condition:
            self._next_tick = self._clock.now_ns()
            self._start_delay()
        while True:
            with self._condition:
                self._completed = self._position
                self._condition.notify_all()
                if self._is_held and not self._jump:
                    self._is_held = False
                    self._anchor_ns = self._earliest(self._clock.now_ns())
                event = self._next_event()
            if event is None:
                return
            yield event

    def sent(self, messages: int) -> None:
        """Report the number of messages published for the last Send."""
        if self._burst_left:
            with self._condition:
                self._burst_left = max(0, self._burst_left - messages)
                self._burst_sent += messages

    def _next_event(self) -> Event | None:
        while not self._stopped:
            if self._jump:
                self._jump = False
                return Jump(self._position, self._time_ns(self._clock.now_ns()))
            now = self._clock.now_ns()
            if self._options.clock_hz and now >= self._next_tick:
                period = int(_SECOND / self._options.clock_hz)
                self._next_tick = max(self._next_tick + period, now)
                return Tick(self._time_ns(now))
            due = self._due_ns(now)
            if due is not None and due <= now:
                if self._position < len(self._stamps):
                    return self._send(due)
                if not self._begin_again():
                    return None
                continue
            if now >= self._next_idle and (due is None or due - now > _LONG_WAIT_NS):
                self._next_idle = now + _IDLE_EVERY_NS
                return Idle(None if due is None else due - now)
            self._wait(now, due)
        return None

    def _send(self, due: int) -> Send:
        event = Send(self._position, due)
        if self._rushing or self._options.lossless:
            self._anchor_ns, self._anchor_stamp = due, self._stamps[self._position]
        self._position += 1
        self._next_idle = 0
        self._skip_gap(due, self._stamps[event.position])
        return event

    def _skip_gap(self, due: int, stamp_ns: int) -> None:
        """Go on shortly before the next sample if it is long after a time, due at steady time."""
        at_end = self._position >= len(self._stamps)
        if self._longest_gap_ns is None or at_end or self._paused or self._options.lossless:
            return
        resumed_ns = self._stamps[self._position] - self._longest_gap_ns
        if resumed_ns > stamp_ns:
            self._anchor_ns, self._anchor_stamp = due, resumed_ns

    @property
    def _rushing(self) -> bool:
        return self._position < self._rush_until or self._burst_left > 0

    def _due_ns(self, now: int) -> int | None:
        """Return when the next event is due, steady time; None while paused."""
        at_end = self._position >= len(self._stamps)
        if self._rushing and not at_end:
            return now
        if self._paused or self._waiting:
            return None
        if at_end:
            return now
        if self._options.lossless:
            return max(now, self._anchor_ns)
        ahead = self._stamps[self._position] - self._anchor_stamp
        rate: float = self._options.rate
        return self._anchor_ns + int(ahead / rate)

    def _begin_again(self) -> bool:
        """At the end, begin the next round or pause; False if playback is over."""
        if self._options.loop == 0 or self._round < self._options.loop:
            self._round += 1
            self._move(0, self._stamps[0])
            return True
        if self._options.at_end is AtEnd.PAUSE:
            self._hold()
            return True
        return False

    def _wait(self, now: int, due: int | None) -> None:
        moments = [self._next_idle] if self._next_idle > now else []
        if due is not None:
            moments.append(due)
        if self._options.clock_hz:
            moments.append(self._next_tick)
        seconds = (min(moments) - now) / _SECOND if moments else None
        self._clock.wait(self._condition, seconds)

    # Time.

    def _time_ns(self, now: int) -> int:
        """Return the recording's time; never later than the next unsent sample."""
        stamp = self._anchor_stamp
        still = self._is_held or self._paused or self._waiting or self._options.lossless
        if not still:
            stamp += max(0, int((now - self._anchor_ns) * self._options.rate))
        return min(stamp, self._stamps[min(self._position, len(self._stamps) - 1)])

    def _set_anchor(self) -> None:
        now = self._clock.now_ns()
        self._anchor_stamp = self._time_ns(now)
        self._anchor_ns = self._earliest(now)

    def _start_delay(self) -> None:
        self._begin_ns = self._clock.now_ns() + self._options.delay_ns
        self._anchor_ns = self._begin_ns

    def _earliest(self, now: int) -> int:
        """Return when time may run at the earliest: not during the delay."""
        return max(now, self._begin_ns)

    def _hold(self) -> None:
        self._set_anchor()
        self._paused = True

    def _move(self, position: int, stamp_ns: int) -> None:
        self._position = self._completed = position
        self._rush_until = self._burst_left = 0
        self._anchor_ns, self._anchor_stamp = self._earliest(self._clock.now_ns()), stamp_ns
        self._skip_gap(self._anchor_ns, stamp_ns)
        self._jump = self._is_held = True
        self._next_idle = 0

    def _wake(self) -> None:
        self._next_idle = 0
        self._condition.notify_all()
