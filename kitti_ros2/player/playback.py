# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is due when: the clock, the position and the controls of a player. No ROS, no disk.

One thread walks through Playback.events and does what each event says; any other thread may call
the controls. The semantics are those of `ros2 bag play`, with frames in place of single messages.
"""

from __future__ import annotations

import sys
import threading
import time
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np

from ..model.errors import UsageError
from ..options.playback import AtEnd, PlaybackOptions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.samples import Int64Array

_SECOND = 1_000_000_000
_LONG_WAIT_NS = 4_000_000
_IDLE_EVERY_NS = 50_000_000
"""A long wait is an opportunity for other work: at its beginning, and again and again."""


@dataclass(frozen=True)
class Send:
    """The sample at a position is due; due_ns is steady time, in nanoseconds."""

    position: int
    due_ns: int


@dataclass(frozen=True)
class Jump:
    """The position was moved: what subscribers keep of another time must be renewed."""

    position: int
    stamp_ns: int


@dataclass(frozen=True)
class Tick:
    """The recording's time is to be told."""

    stamp_ns: int


@dataclass(frozen=True)
class Idle:
    """Nothing is due for a while: so many nanoseconds, None while paused or waiting."""

    for_ns: int | None


Event: TypeAlias = 'Send | Jump | Tick | Idle'


@dataclass(frozen=True)
class PlaybackState:
    """Where a playback stands.

    Attributes:
        frame: Number of the frame that was sent last, or comes first.
        stamp_ns: The recording's time, nanoseconds since 1970.
        offset_ns: The same from the first stamp.
        rate: Seconds of recording a second.
        paused: Whether time stands still.
        finished: Whether everything is sent.
        round: The how-manieth time it is played, from 1.
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


class Clock(Protocol):
    """Steady time, and waiting in it."""

    def now_ns(self) -> int:
        """Nanoseconds that only ever grow."""

    def wait(self, condition: threading.Condition, seconds: float | None) -> None:
        """Wait for a notification, at most so long; the condition is held."""


class SteadyClock:
    """The machine's own."""

    @staticmethod
    def now_ns() -> int:
        """As Clock has it."""
        return time.monotonic_ns()

    @staticmethod
    def wait(condition: threading.Condition, seconds: float | None) -> None:
        """As Clock has it."""
        condition.wait(seconds)


class Playback:
    """Plays positions 0 .. N-1 in time.

    Args:
        stamps_ns: (N,) int64 nanoseconds, ascending; N > 0.
        frames: (N,) int64 frame numbers, never falling.
        options: How it is played.
        clock: Steady time.
    """

    def __init__(
        self,
        stamps_ns: Int64Array,
        frames: Int64Array,
        options: PlaybackOptions,
        clock: Clock | None = None,
    ) -> None:
        self._stamps: list[int] = stamps_ns.tolist()
        numbers, starts = np.unique(frames, return_index=True)
        self._frame_numbers: list[int] = numbers.tolist()
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
        self._next_idle = 0
        now = self._clock.now_ns()
        self._begin_ns: int = now + options.delay_ns
        self._anchor_ns: int = self._begin_ns
        self._anchor_stamp: int = self._stamps[0]
        self._next_tick = now

    # The walk.

    def events(self) -> Iterator[Event]:
        """What to do, each when it is due; ends when all is played, or stopped."""
        with self._condition:
            self._next_tick = self._clock.now_ns()
            self._start_delay()
        while True:
            with self._condition:
                self._completed = self._position
                self._condition.notify_all()
                event = self._next_event()
            if event is None:
                return
            yield event

    def sent(self, messages: int) -> None:
        """Tell how many messages the last Send became."""
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
        return event

    @property
    def _rushing(self) -> bool:
        return self._position < self._rush_until or self._burst_left > 0

    def _due_ns(self, now: int) -> int | None:
        """When the next thing is due, steady time; None while paused."""
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
        """At the end: begin the next round or hold; False when it is over."""
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
        """The recording's time; never beyond what is still to be sent."""
        stamp = self._anchor_stamp
        if not (self._paused or self._waiting or self._options.lossless):
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
        """When time may run: not during the delay."""
        return max(now, self._begin_ns)

    def _hold(self) -> None:
        self._set_anchor()
        self._paused = True

    def _move(self, position: int, stamp_ns: int) -> None:
        self._position = self._completed = position
        self._rush_until = self._burst_left = 0
        self._anchor_ns, self._anchor_stamp = self._earliest(self._clock.now_ns()), stamp_ns
        self._jump = True
        self._next_idle = 0

    # The controls.

    @property
    def options(self) -> PlaybackOptions:
        """How it is played now."""
        return self._options

    @property
    def stopped(self) -> bool:
        """Whether it was told to stop."""
        return self._stopped

    def state(self) -> PlaybackState:
        """Where it stands."""
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
        """Index of the frame of what was sent last."""
        return bisect_right(self._frame_starts, max(0, self._position - 1)) - 1

    def pause(self) -> None:
        """Let time stand still."""
        with self._condition:
            if not self._paused:
                self._hold()
            self._wake()

    def resume(self) -> None:
        """Let time go on."""
        with self._condition:
            if self._paused:
                self._anchor_ns = self._earliest(self._clock.now_ns())
                self._paused = False
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
        """Take other values of rate, loop or step.

        Raises:
            UsageError: A value is out of range; the old ones stay.
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
            UsageError: There is no such frame.
        """
        with self._condition:
            index = bisect_left(self._frame_numbers, number)
            if index >= len(self._frame_numbers) or self._frame_numbers[index] != number:
                first, last = self._frame_numbers[0], self._frame_numbers[-1]
                raise UsageError(f'there is no frame {number}; there are {first} to {last}')
            position = self._frame_starts[index]
            self._move(position, self._stamps[position])
            self._wake()

    def seek(self, stamp_ns: int) -> None:
        """Go to a time; what comes next is the first sample not before it.

        Args:
            stamp_ns: Nanoseconds since 1970; one before the first is the first.

        Raises:
            UsageError: It is after the last stamp.
        """
        with self._condition:
            if stamp_ns > self._stamps[-1]:
                late = (stamp_ns - self._stamps[-1]) / _SECOND
                raise UsageError(f'the time asked for is {late:.3f} s after the end')
            stamp_ns = max(stamp_ns, self._stamps[0])
            self._move(bisect_left(self._stamps, stamp_ns), stamp_ns)
            self._wake()

    def show(self, stamp_ns: int) -> None:
        """Go to the frame of the last sample not after a time and, while paused, play it at once.

        Args:
            stamp_ns: Nanoseconds since 1970; one before the first is the first.
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
        """Go to a time from the first stamp, in nanoseconds; see seek."""
        self.seek(self._stamps[0] + offset_ns)

    def play_next(self, timeout: float = 5.0) -> bool:
        """Play the next frames while paused, at once; `step` of the options says how many.

        Returns:
            Whether something was played: not while time runs, nor at the end.
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
        """While paused, go back by a frame and play it.

        Returns:
            Whether there is one before.
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
        """Play some messages at once while paused; whole samples, so it may be a few more.

        Args:
            messages: How many; 0 takes all that are left.
            timeout: Seconds to wait for it.

        Returns:
            How many were played.
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
        """End it."""
        with self._condition:
            self._stopped = True
            self._wake()

    def _wake(self) -> None:
        self._next_idle = 0
        self._condition.notify_all()
