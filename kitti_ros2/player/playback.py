# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Playback: a schedule with controls. No ROS, no disk.

One thread iterates over Playback.events and handles each event; any other thread may call the
controls. The semantics are those of `ros2 bag play`, with frames in place of single messages.
"""

from __future__ import annotations

import sys
import threading
import time
from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..model.errors import UsageError, describe_frames
from ..options.outputs import AtEnd

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ..model.samples import Int64Array
    from ..options.outputs import PlaybackOptions


# The events of a playback, and the clock that schedules them. No ROS, no disk.


@dataclass(frozen=True)
class Send:
    """The sample at a position is due; due_ns is steady time, in nanoseconds."""

    position: int
    due_ns: int


@dataclass(frozen=True)
class Jump:
    """A seek: resend latched messages, delete stale markers."""

    position: int
    stamp_ns: int


@dataclass(frozen=True)
class Tick:
    """The recording's time is due for publishing."""

    stamp_ns: int


@dataclass(frozen=True)
class Idle:
    """Nothing is due for a number of nanoseconds; None while paused or waiting."""

    for_ns: int | None


Event: TypeAlias = 'Send | Jump | Tick | Idle'


class SteadyClock:
    """The monotonic clock of the machine, with a wait."""

    @staticmethod
    def now_ns() -> int:
        """Return monotonic time in nanoseconds."""
        return time.monotonic_ns()

    @staticmethod
    def wait(condition: threading.Condition, seconds: float | None) -> None:
        """Wait for a notification or a timeout; the condition is held."""
        condition.wait(seconds)


# The schedule of a playback: which event is due when. No ROS, no disk.

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
        # Time is stopped before the start, and from a jump until it is handled.
        self._time_stopped = True
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
                if self._time_stopped and not self._jump:
                    self._time_stopped = False
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
        times = [self._next_idle] if self._next_idle > now else []
        if due is not None:
            times.append(due)
        if self._options.clock_hz:
            times.append(self._next_tick)
        seconds = (min(times) - now) / _SECOND if times else None
        self._clock.wait(self._condition, seconds)

    # Time.

    def _time_ns(self, now: int) -> int:
        """Return the recording's time; never later than the next unsent sample."""
        stamp = self._anchor_stamp
        still = self._time_stopped or self._paused or self._waiting or self._options.lossless
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
        self._jump = self._time_stopped = True
        self._next_idle = 0

    def _wake(self) -> None:
        self._next_idle = 0
        self._condition.notify_all()


@dataclass(frozen=True)
class PlaybackState:
    """The state of a playback.

    Attributes:
        frame: Number of the last sent frame, or of the first one.
        stamp_ns: The recording's time, nanoseconds since 1970.
        offset_ns: The same relative to the first stamp.
        rate: Seconds of recording per second.
        paused: Whether playback is paused.
        finished: Whether everything is sent.
        round: Loop count, from 1.
        waiting: Whether it waits for subscribers before it begins.
    """

    frame: int
    stamp_ns: int
    offset_ns: int
    rate: float
    paused: bool
    finished: bool
    round: int
    waiting: bool = False


class Playback(PlaybackSchedule):
    """Plays positions 0 .. N-1 in time; see PlaybackSchedule for the arguments."""

    @property
    def options(self) -> PlaybackOptions:
        """The current options."""
        return self._options

    @property
    def stopped(self) -> bool:
        """True if a stop was requested."""
        return self._stopped

    def state(self) -> PlaybackState:
        """Return the current state."""
        with self._condition:
            stamp = self._time_ns(self._clock.now_ns())
            return PlaybackState(
                frame=self._frame_numbers[self._shown()],
                stamp_ns=stamp,
                offset_ns=stamp - self._stamps[0],
                rate=self._options.rate,
                paused=self._paused,
                finished=self._position >= len(self._stamps),
                round=self._round,
                waiting=self._waiting,
            )

    def _shown(self) -> int:
        """Return the index of the frame of the last sent sample."""
        return bisect_right(self._frame_starts, max(0, self._position - 1)) - 1

    def pause(self) -> None:
        """Pause."""
        with self._condition:
            if not self._paused:
                self._hold()
            self._wake()

    def resume(self) -> None:
        """Resume."""
        with self._condition:
            if self._paused:
                self._anchor_ns = self._earliest(self._clock.now_ns())
                self._paused = False
                self._skip_gap(self._anchor_ns, self._anchor_stamp)
            self._wake()

    def begin(self) -> None:
        """End the wait for subscribers; the delay counts from now."""
        with self._condition:
            if self._waiting:
                self._waiting = False
                self._start_delay()
            self._wake()

    def toggle_paused(self) -> bool:
        """Pause or resume; returns whether it is paused now."""
        with self._condition:
            paused = self._paused
        self.resume() if paused else self.pause()
        return not paused

    def change(self, **values: float) -> None:
        """Change rate, loop or step.

        Raises:
            UsageError: A value is out of range; nothing is changed.
        """
        with self._condition:
            changed = replace(self._options, **values)  # type: ignore[arg-type] # by name
            if not self._paused:
                self._set_anchor()
            self._options = changed
            self._wake()

    def seek_frame(self, number: int) -> None:
        """Go to the first sample of a frame.

        Raises:
            UsageError: The frame does not exist.
        """
        with self._condition:
            if number not in self._frame_numbers:
                frames = describe_frames(sorted(self._frame_numbers))
                raise UsageError(f'there is no frame {number}; it has {frames}')
            position = self._frame_starts[self._frame_numbers.index(number)]
            self._move(position, self._stamps[position])
            self._wake()

    def seek(self, stamp_ns: int) -> None:
        """Go to a time; the first sample not before it is next.

        Args:
            stamp_ns: Nanoseconds since 1970; clamped to the first stamp.

        Raises:
            UsageError: The time is after the last stamp.
        """
        with self._condition:
            if stamp_ns > self._stamps[-1]:
                late = (stamp_ns - self._stamps[-1]) / _SECOND
                raise UsageError(f'the requested time is {late:.3f} s after the end')
            stamp_ns = max(stamp_ns, self._stamps[0])
            self._move(bisect_left(self._stamps, stamp_ns), stamp_ns)
            self._wake()

    def show(self, stamp_ns: int) -> None:
        """Go to the frame of the last sample not after a time and, while paused, play it at once.

        Args:
            stamp_ns: Nanoseconds since 1970; clamped to the first stamp.
        """
        with self._condition:
            last = max(0, bisect_right(self._stamps, stamp_ns) - 1)
            frame = bisect_right(self._frame_starts, last) - 1
            start, *following = [*self._frame_starts[frame : frame + 2], len(self._stamps)]
            self._move(start, self._stamps[start])
            if self._paused:
                self._rush_until = following[0]
            self._wake()

    def seek_offset(self, offset_ns: int) -> None:
        """Go to a time relative to the first stamp, in nanoseconds; see seek."""
        self.seek(self._stamps[0] + offset_ns)

    def play_next(self, timeout: float = 5.0) -> bool:
        """Play the next frames at once while paused; the option `step` is their number.

        Returns:
            Whether something was played: False while not paused, and at the end.
        """
        with self._condition:
            if not self._paused or self._position >= len(self._stamps):
                return False
            target = self._position + 1
            if self._options.step:
                frame = bisect_right(self._frame_starts, self._position) - 1
                following = [*self._frame_starts[frame + 1 :], len(self._stamps)]
                target = following[min(self._options.step, len(following)) - 1]
            self._rush_until = target
            self._wake()
            return self._condition.wait_for(lambda: self._arrived(target), timeout)

    def _arrived(self, target: int) -> bool:
        return self._stopped or self._completed >= target

    def play_previous(self, timeout: float = 5.0) -> bool:
        """Go back one frame while paused, and play it.

        Returns:
            Whether a previous frame exists.
        """
        with self._condition:
            frame = self._shown() - 1
            if not self._paused or frame < 0:
                return False
            start = self._frame_starts[frame]
            self._move(start, self._stamps[start])
            target = self._rush_until = self._frame_starts[frame + 1]
            self._wake()
            return self._condition.wait_for(lambda: self._arrived(target), timeout)

    def burst(self, messages: int, timeout: float = 60.0) -> int:
        """Play some messages at once while paused; whole samples, so possibly a few more.

        Args:
            messages: Their number; 0 plays all that remain.
            timeout: Seconds to wait.

        Returns:
            The number of messages played.
        """
        with self._condition:
            if not self._paused:
                return 0
            self._burst_sent = 0
            self._burst_left = messages or sys.maxsize
            self._wake()
            self._condition.wait_for(self._burst_over, timeout)
            self._burst_left = 0
            return self._burst_sent

    def _burst_over(self) -> bool:
        return self._stopped or not self._burst_left or self._completed >= len(self._stamps)

    def stop(self) -> None:
        """Stop."""
        with self._condition:
            self._stopped = True
            self._wake()


# The answers of a stack to the frames that it is sent: pace, latency, what is missing. No ROS.
#
# A subscriber acknowledges a message when it is in its queue, not when it is processed, so a slow
# node would lose frames of a player that only waits for acknowledgements, and its latency would be
# that of the queue. Here the next frame is sent when the one before is answered. A node may answer
# later than that (a synchroniser that waits for the next message) or skip frames: if no answer
# comes for some time, one more frame may be on its way.

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
                index = self._open.index(frame)
                del self._open[: index + 1]
                if not self._open and not index:
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
        """Return whether no answer is expected any more, after the last frame was sent."""
        with self._condition:
            return not self._open or self._now_ns() - self._moved_ns >= self._patience_ns()

    def silent(self) -> bool:
        """Return whether frames are on their way, without an answer within the time limit."""
        with self._condition:
            if not self._open:
                return False
            since = max(self._answered_ns, self._sent_ns[self._open[0]])
            return self._now_ns() - since >= self._timeout_ns

    def flooded(self) -> bool:
        """Return whether far more messages came than frames were sent."""
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
        index = bisect_left(self._stamps, stamp_ns)
        near = self._stamps[max(0, index - 1) : index + 1]
        nearest = min(near, key=lambda near_ns: abs(near_ns - stamp_ns), default=None)
        if nearest is None or abs(nearest - stamp_ns) > _TOLERANCE_NS:
            return None
        return self._frames[nearest]
