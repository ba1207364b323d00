# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Playback: a schedule with controls. No ROS, no disk.

One thread iterates over Playback.events and handles each event; any other thread may call the
controls. The semantics are those of `ros2 bag play`, with frames in place of single messages.
"""

from __future__ import annotations

import sys
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..model.losses import describe_frames
from .playback_schedule import PlaybackSchedule

if TYPE_CHECKING:
    from ..options.playback import PlaybackOptions

_SECOND = 1_000_000_000


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
        """Whether a stop was requested."""
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
                known = describe_frames(sorted(self._frame_numbers))
                raise UsageError(f'there is no frame {number}; it has {known}')
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
