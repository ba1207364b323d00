# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a recording by stamp, and the time of a player by log time.

All evaluations match the stamps of results to frames here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from ..importer.sync import NONE, default_tolerance_ns
from ..kitti.turns import find_turns
from ..model.nearest import nearest_stamps
from ..model.stamps import LAST_NS
from ..model.streams import FRAME_STREAMS, Stream

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model.layouts import Layout
    from ..model.recording import StreamIndex
    from ..model.samples import Int64Array, Turn

_STAMPED = tuple(stream for stream in FRAME_STREAMS if stream not in {Stream.OXTS, Stream.POSE})
ROUNDED_NS = 1_000_000
"""Stamps pass through float64 seconds, or microseconds."""


class FramedRecording(Protocol):
    """The part of a recording that its frames have their stamps from."""

    layout: Layout
    common_numbers: bool

    @property
    def streams(self) -> Mapping[Stream, StreamIndex]:
        """Index by stream."""
        ...

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps."""
        ...

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan; empty of scans that are compensated for motion."""
        ...


class StampMatch(NamedTuple):
    """The frames of M stamps.

    Attributes:
        numbers: (M,) of the frame, NONE where the nearest is too far.
        distances_ns: (M,) from the nearest stamp of the frame, nanoseconds.
        offsets_ns: (M,) how much later than the frame they are: 0 at the stamp of a sensor.
        moment: What they are stamps of; empty: of sensors, or of nothing known.
    """

    numbers: Int64Array
    distances_ns: Int64Array
    offsets_ns: Int64Array
    moment: str = ''


class _Moments(NamedTuple):
    """A stamp of each of N frames.

    Attributes:
        name: For users; empty for the samples of a sensor.
        numbers: (N,) of the frames.
        stamps_ns: (N,) ascending.
        late_ns: (N,) how much later than the frame they are.
    """

    name: str
    numbers: Int64Array
    stamps_ns: Int64Array
    late_ns: Int64Array

    def frames_at(self, stamps_ns: Int64Array, within_ns: int) -> int:
        """Return how many of the frames have one of (M,) stamps."""
        place, off = nearest_stamps(self.stamps_ns, stamps_ns)
        return len(np.unique(place[np.abs(off) <= within_ns]))


class StampedFrames:
    """The frames of a recording by stamp.

    A frame has the stamps of its scan and of its images; results are stamped at one of them. It
    also has the start of the scanner's turn, which is the stamp of a scan with ring time, and the
    end, which is that of odometry whose scans are compensated to it. These are half a period from
    the frame, as near to another: a stamp is at one of them if it differs by rounding only. The end
    of a turn is also the start of the next, so all stamps of a result are judged together.

    Args:
        samples: Of the sensors, by number of the frame; the first is the moment of the frame.
        tolerance_ns: The largest distance from the stamp of a frame.
        turns: By number of the frame.

    Attributes:
        numbers: Of the frames to be answered, ascending.
        stamps_ns: (N,) those of the samples, ascending.
        tolerance_ns: As given.
        first_ns: The stamp of the first frame.
    """

    def __init__(
        self,
        samples: Sequence[StreamIndex],
        tolerance_ns: int,
        turns: Mapping[int, Turn] | None = None,
    ) -> None:
        numbers = np.concatenate([index.numbers for index in samples])
        stamps = np.concatenate([index.stamps_ns for index in samples])
        order = np.argsort(stamps, kind='stable')
        self.stamps_ns, self._numbers = stamps[order], numbers[order]
        self._first_of: dict[int, int] = {}
        for number, stamp in zip(self._numbers.tolist(), self.stamps_ns.tolist(), strict=True):
            self._first_of.setdefault(number, stamp)
        self._known, first = np.unique(numbers, return_index=True)
        self._moments_ns = stamps[first]
        self._moments = _moments_of(samples, turns or {})
        self.numbers: list[int] = self._known.tolist()
        self.first_ns = int(self.stamps_ns[0])
        self.tolerance_ns = tolerance_ns

    def stamp_of(self, number: int) -> int:
        """Return the first stamp of a frame."""
        return self._first_of[number]

    def moment_of(self, number: int) -> int:
        """Return the stamp of a frame: that of its scan, or of the first of its other samples."""
        return int(self._moments_ns[np.searchsorted(self._known, number)])

    def match(self, stamps_ns: Int64Array, tolerance_ns: int | None = None) -> StampMatch:
        """Match the stamps of a result to frames.

        Args:
            stamps_ns: (M,) in any order.
            tolerance_ns: Another one than that of the frames.
        """
        tolerance = self.tolerance_ns if tolerance_ns is None else tolerance_ns
        place, off = nearest_stamps(self.stamps_ns, stamps_ns)
        distances, nearest = np.abs(off), self._numbers[place]
        offsets = stamps_ns - self._moments_ns[np.searchsorted(self._known, nearest)]
        numbers = np.where(distances <= tolerance, nearest, NONE)
        rounded = min(ROUNDED_NS, tolerance)
        frames, best = max(
            ((each.frames_at(stamps_ns, rounded), each) for each in self._moments),
            key=lambda pair: pair[0],
        )
        if 2 * frames < min(len(stamps_ns), len(self.numbers)):
            return StampMatch(numbers, distances, offsets)
        place, off = nearest_stamps(best.stamps_ns, stamps_ns)
        at_it = np.abs(off) <= rounded
        return StampMatch(
            np.where(at_it, best.numbers[place], numbers),
            np.where(at_it, np.abs(off), distances),
            np.where(at_it, off + best.late_ns[place], offsets),
            best.name,
        )

    def nearest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the frame of a stamp and its distance; None if it is too far."""
        found = self.match(np.array([min(stamp_ns, LAST_NS)], dtype=np.int64))
        number = int(found.numbers[0])
        return None if number == NONE else (number, int(found.distances_ns[0]))

    def latest(self, stamp_ns: int) -> tuple[int, int] | None:
        """Return the number of the last frame before a time and the distance.

        None if it is further than twice the tolerance, which is the time between frames.
        """
        place = int(np.searchsorted(self.stamps_ns, stamp_ns, 'right')) - 1
        distance = stamp_ns - int(self.stamps_ns[place]) if place >= 0 else -1
        within = 0 <= distance <= 2 * self.tolerance_ns
        return (int(self._numbers[place]), distance) if within else None


def frames_of(recording: FramedRecording, tolerance_ns: int | None = None) -> StampedFrames:
    """Return the frames of a recording that results are expected of.

    These are the frames with labels where each frame has a file of labels, else all with a scan or
    an image.

    Args:
        recording: The recording.
        tolerance_ns: The largest distance from the stamp of a frame; None is half the median time
            between frames, at most half the nominal one.
    """
    streams = recording.streams
    known: list[Stream] = [stream for stream in _STAMPED if stream in streams]
    found = _stamped_by(recording, known or [*streams], tolerance_ns)
    if Stream.LABELS in streams and recording.layout.traits.frame_set:
        found.numbers = sorted({*streams[Stream.LABELS].numbers.tolist()})
    return found


def posed_frames_of(recording: FramedRecording) -> StampedFrames:
    """Return the frames of a recording with poses; they also have the stamps of these."""
    known = [stream for stream in _STAMPED if stream in recording.streams]
    return _stamped_by(
        recording, [*known, Stream.POSE] if recording.common_numbers else [Stream.POSE], None
    )


def _stamped_by(
    recording: FramedRecording, known: Sequence[Stream], tolerance_ns: int | None
) -> StampedFrames:
    """Return frames with the stamps of some streams.

    Args:
        recording: The recording.
        known: The streams; the first has the numbers of frames where others have their own.
        tolerance_ns: As frames_of.
    """
    used = [recording.streams[each] for each in known]
    if tolerance_ns is None:
        tolerance_ns = min(default_tolerance_ns(used[0].stamps_ns), recording.period_ns // 2)
    if not recording.common_numbers:
        return StampedFrames(used[:1], tolerance_ns)
    return StampedFrames(used, tolerance_ns, _turns(recording))


def _moments_of(samples: Sequence[StreamIndex], turns: Mapping[int, Turn]) -> list[_Moments]:
    """Return the samples of each sensor, and starts and ends of turns."""
    none = np.zeros(1, dtype=np.int64)
    found = [('', index.numbers, index.stamps_ns, none) for index in samples]
    if turns:
        rows = [
            (number, turn.start_ns, turn.forward_ns, turn.end_ns) for number, turn in turns.items()
        ]
        numbers, starts, forward, ends = np.array(rows, dtype=np.int64).T
        found.append(('start of turn', numbers, starts, starts - forward))
        found.append(('end of turn', numbers, ends, ends - forward))
    return [_in_order(*each) for each in found]


def _in_order(
    name: str, numbers: Int64Array, stamps_ns: Int64Array, late_ns: Int64Array
) -> _Moments:
    order = np.argsort(stamps_ns, kind='stable')
    late = np.broadcast_to(late_ns, order.shape)
    return _Moments(name, numbers[order], stamps_ns[order], late[order])


def _turns(recording: FramedRecording) -> Mapping[int, Turn]:
    """Return the turns of a recording, also of scans that it has not, or that are compensated.

    Its scans may have been played with --undo-deskew.
    """
    if recording.turns:
        return recording.turns
    streams = recording.streams
    index = streams[Stream.SCAN] if Stream.SCAN in streams else next(iter(streams.values()))
    forward = dict(zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True))
    return find_turns(forward, {}, {}, recording.period_ns)


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
