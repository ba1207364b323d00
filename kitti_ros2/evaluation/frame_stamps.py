# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a recording by stamp, and the time of a player by log time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..importer.sync import default_tolerance_ns
from ..model.streams import FRAME_STREAMS, Stream

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..kitti.recording import KittiRecording
    from ..model.samples import Int64Array

_STAMPED = tuple(stream for stream in FRAME_STREAMS if stream not in {Stream.OXTS, Stream.POSE})


class StampedFrames:
    """The frames of a recording by stamp.

    A frame has the stamps of its scan and of its images, also the start of the turn, which is the
    stamp of a scan with ring time.

    Args:
        recording: The recording.
        tolerance_ns: The largest distance from the stamp of a frame; None is half the median time
            between frames, at most half the nominal one.

    Attributes:
        numbers: Of the frames to be answered, ascending: those with labels where each frame has a
            file of labels, else all.
        tolerance_ns: As given, or its default.
        first_ns: The stamp of the first frame.
    """

    def __init__(self, recording: KittiRecording, tolerance_ns: int | None = None) -> None:
        streams = recording.streams
        known: list[Stream] = [stream for stream in _STAMPED if stream in streams]
        known = known or [*streams]
        used = known if recording.common_numbers else known[:1]
        numbers = np.concatenate([streams[stream].numbers for stream in used])
        stamps = np.concatenate([streams[stream].stamps_ns for stream in used])
        order = np.argsort(stamps, kind='stable')
        self._stamps, self._numbers = stamps[order], numbers[order]
        self._starts = {turn.start_ns: number for number, turn in recording.turns.items()}
        self._first_of: dict[int, int] = {}
        for number, stamp in zip(self._numbers.tolist(), self._stamps.tolist(), strict=True):
            self._first_of.setdefault(number, stamp)
        traits = recording.layout.traits
        of_files = Stream.LABELS in streams and traits.frame_set
        frames = streams[Stream.LABELS].numbers if of_files else numbers
        self.numbers: list[int] = sorted({*frames.tolist()})
        self.first_ns = int(self._stamps[0])
        half_ns = min(default_tolerance_ns(streams[used[0]].stamps_ns), recording.period_ns // 2)
        self.tolerance_ns = half_ns if tolerance_ns is None else tolerance_ns

    def stamp_of(self, number: int) -> int:
        """Return the first stamp of a frame."""
        return self._first_of[number]

    def nearest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the frame of a stamp and its distance; None if it is too far."""
        place = int(np.searchsorted(self._stamps, stamp_ns))
        near = range(max(place - 1, 0), min(place + 1, len(self._stamps)))
        distance, best = min((abs(int(self._stamps[each]) - stamp_ns), each) for each in near)
        if distance and stamp_ns in self._starts:
            return self._starts[stamp_ns], 0
        return (int(self._numbers[best]), distance) if distance <= self.tolerance_ns else None

    def latest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the last frame before a time and the distance.

        None if it is further than twice the tolerance, which is the time between frames.
        """
        place = int(np.searchsorted(self._stamps, stamp_ns, 'right')) - 1
        distance = stamp_ns - int(self._stamps[place]) if place >= 0 else -1
        within = 0 <= distance <= 2 * self.tolerance_ns
        return (int(self._numbers[place]), distance) if within else None


class PlayedTime:
    """The recording's time at the log times of a bag, by the messages of /clock in it.

    Without such messages log times are taken for it: recorders with use_sim_time store it.

    Args:
        log_ns: (N,) log times of the messages, ascending.
        clock_ns: (N,) the times in them.
    """

    def __init__(self, log_ns: Sequence[int], clock_ns: Sequence[int]) -> None:
        self._log: Int64Array = np.array(log_ns, dtype=np.int64)
        self._clock: Int64Array = np.array(clock_ns, dtype=np.int64)

    def at(self, log_ns: int) -> int:
        """Return the time of the last message of /clock before a log time."""
        if not len(self._log):
            return log_ns
        place = int(np.searchsorted(self._log, log_ns, 'right')) - 1
        return int(self._clock[max(place, 0)])
