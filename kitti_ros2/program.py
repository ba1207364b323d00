# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a player plays: messages in order of time, each to be had by its position."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .encoder import Encoder
from .errors import describe_error
from .messages.cdr import join
from .messages.ros_types import TYPESTORE
from .samples import Stream
from .schedule import ONCE, make_schedule

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Sequence

    from .encoder import Failure, Message
    from .messages.ros_types import Typestore
    from .options import MessageOptions, SelectionOptions
    from .samples import Int64Array, Recording
    from .schedule import Schedule


class Outlet(NamedTuple):
    """A topic that is played.

    Attributes:
        name: Topic name.
        msgtype: Message type, such as sensor_msgs/msg/Imu.
        latched: Whether it is transient local, for subscribers that come late.
        depth: How many messages its publisher keeps.
        on_demand: Whether its messages are large, and made only while somebody subscribes.
    """

    name: str
    msgtype: str
    latched: bool
    depth: int
    on_demand: bool


class Due(NamedTuple):
    """One message, ready to be published.

    Attributes:
        outlet: Index of its topic in Program.outlets.
        stamp_ns: Nanoseconds since 1970.
        data: CDR with its encapsulation header.
        key: What it depends on, where one equal to the topic's last need not be sent again.
    """

    outlet: int
    stamp_ns: int
    data: bytes
    key: Hashable = None


class Missing(NamedTuple):
    """Messages that could not be made: why, in a line, and how many."""

    text: str
    messages: int


class Program(Protocol):
    """Messages by position; fetch may be called from `workers` threads at once.

    Attributes:
        name: What is played, for people.
        outlets: The topics.
        stamps_ns: (N,) int64 nanoseconds, ascending.
        frames: (N,) int64 frame numbers, never falling.
        workers: How many threads may fetch at once.
        typestore: Knows the types of the outlets.
        losses: What is missing from the start, and more that was found meanwhile, in words.
    """

    name: str
    outlets: Sequence[Outlet]
    stamps_ns: Int64Array
    frames: Int64Array
    workers: int
    typestore: Typestore

    @property
    def losses(self) -> tuple[str, ...]:
        """What is missing, in words."""

    def notes(self) -> tuple[str, ...]:
        """What is worth a word of what was fetched so far."""

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Due], list[Missing]]:
        """The messages at a position, and what could not be made of it.

        Args:
            index: 0 .. N-1.
            wanted: The outlets with a subscriber; those on demand are left out where absent here.
        """

    def latched_before(self, index: int) -> list[Due]:
        """For each latched topic the last messages that come before a position."""

    def close(self) -> None:
        """Let go of files."""


class RecordingProgram:
    """A KITTI recording, each sample read and encoded when it is fetched.

    Raises:
        UsageError: The selection takes nothing.
    """

    def __init__(
        self,
        recording: Recording,
        messages: MessageOptions,
        selection: SelectionOptions,
        workers: int,
    ) -> None:
        schedule = make_schedule(recording, selection)
        self._encoder = Encoder(recording, schedule, messages, selection)
        self._entries = list(schedule)
        self._latched = _latched_entries(schedule, self._encoder)
        self._recording = recording
        self.name = f'{recording.layout.value} {recording.name}'
        self.outlets: Sequence[Outlet] = [
            Outlet(row.name, row.msgtype, row.latched, row.depth, row.on_demand)
            for row in self._encoder.table
        ]
        self.stamps_ns = schedule.stamps_ns
        self.frames = frame_numbers(schedule, numbered=recording.common_numbers)
        self.workers = workers
        self.typestore: Typestore = TYPESTORE
        self._losses = self._encoder.concerned(recording.losses)
        self._named: set[str] = set()
        self._unsent: dict[str, str] = {}

    @property
    def losses(self) -> tuple[str, ...]:
        """What is missing from the start, and what passes over many samples could not read."""
        late = {
            loss.text(): f'{loss.stream}: {loss.text()}' for loss in self._recording.late_losses
        }
        late |= self._unsent
        unnamed = [text for reason, text in late.items() if reason not in self._named]
        return (*(f'{loss.stream}: {loss.text()}' for loss in self._losses), *unnamed)

    def notes(self) -> tuple[str, ...]:
        """As Program has it."""
        return (*self._recording.notes, *self._encoder.notes())

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Due], list[Missing]]:
        """As Program has it."""
        due, failures = self._encode(index, wanted)
        self._named.update(describe_error(each.error) for each in failures)
        missing = [
            Missing(f'{", ".join(each.topics)}: {describe_error(each.error)}', len(each.topics))
            for each in failures
        ]
        return due, missing

    def _encode(self, index: int, wanted: Collection[int]) -> tuple[list[Due], list[Failure]]:
        messages, failures = self._encoder.encode(self._entries[index], wanted)
        # Small ones first: each waits for those before it.
        due = sorted(map(_due, messages), key=lambda each: self.outlets[each.outlet].on_demand)
        return due, failures

    def latched_before(self, index: int) -> list[Due]:
        """As Program has it."""
        last: dict[int, list[Due]] = {}
        for positions in self._latched:
            past = int(np.searchsorted(positions, index)) - 1
            if past < 0:
                continue
            messages, failures = self._encode(int(positions[past]), ())
            for each in failures:
                text = f'{", ".join(each.topics)}: {describe_error(each.error)}'
                self._unsent[describe_error(each.error)] = text
            for message in messages:
                if self.outlets[message.outlet].latched:
                    last.setdefault(message.outlet, []).append(message)
        return [message for messages in last.values() for message in messages]

    def close(self) -> None:
        """Nothing stays open between two samples."""


def _due(message: Message) -> Due:
    return Due(message.topic, message.stamp_ns, join(message.parts), message.key)


def _latched_entries(schedule: Schedule, encoder: Encoder) -> list[Int64Array]:
    """By stream with a latched topic, the positions of its entries."""
    streams = {row.stream for row in encoder.table if row.latched}
    codes = [code for code, stream in enumerate(Stream) if stream in streams]
    return [np.flatnonzero(schedule.streams == code) for code in codes]


def frame_numbers(schedule: Schedule, *, numbered: bool) -> Int64Array:
    """(N,) int64: the frame that each entry of a schedule belongs to, never falling.

    Args:
        schedule: The entries.
        numbered: Whether a file number means the same frame in every stream. Where it does not, a
            scan's frame reaches half-way to the scans beside it.
    """
    codes = {stream: code for code, stream in enumerate(Stream)}
    alone = [codes[stream] for stream in ONCE if schedule.count(stream) == 1]
    once = np.isin(schedule.streams, alone)
    if numbered:
        frames = schedule.numbers.copy()
        # What holds for the whole recording is due with whatever comes first.
        frames[once] = frames[~once][0] if not once.all() else 0
        return np.maximum.accumulate(frames)
    reference = max(Stream, key=lambda s: (s is Stream.SCAN and schedule.count(s) > 0,
                                           schedule.count(s) if s not in ONCE else 0))  # fmt: skip
    chosen = schedule.streams == codes[reference]
    if not chosen.any():
        return np.zeros(len(schedule), dtype=np.int64)
    return nearest_frames(schedule.stamps_ns, schedule.stamps_ns[chosen], schedule.numbers[chosen])


def nearest_frames(
    stamps_ns: Int64Array, reference_ns: Int64Array, numbers: Int64Array
) -> Int64Array:
    """(N,) int64: the number of the reference sample nearest to each stamp.

    Args:
        stamps_ns: (N,) nanoseconds, ascending.
        reference_ns: (M,) nanoseconds, ascending, M > 0.
        numbers: (M,) what the reference samples are called, ascending.
    """
    middles = reference_ns[:-1] + np.diff(reference_ns) // 2
    frames: Int64Array = numbers[np.searchsorted(middles, stamps_ns, 'right')]
    return frames
