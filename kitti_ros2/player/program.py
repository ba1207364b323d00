# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A program: messages in order of time, accessible by position."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from ..exporter.encode import Encoder
from ..exporter.schedule import make_schedule
from ..messages.cdr import join
from ..messages.ros_types import TYPESTORE
from ..messages.topics import LARGE_TYPES
from ..model.errors import describe_error
from ..model.losses import Loss
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Collection, Hashable, Sequence

    from ..exporter.encode import Failure
    from ..messages.ros_types import Typestore
    from ..model.recording import Recording
    from ..model.samples import Int64Array
    from ..options.messages import MessageOptions
    from ..options.selection import SelectionOptions


class Outlet(NamedTuple):
    """A topic that is played.

    Attributes:
        name: Topic name.
        msgtype: Message type, such as sensor_msgs/msg/Imu.
        latched: Whether it is transient local, for late subscribers.
        depth: History depth of its publisher.
    """

    name: str
    msgtype: str
    latched: bool
    depth: int

    @property
    def on_demand(self) -> bool:
        """Whether its messages are large, and made only while a subscriber exists."""
        return self.msgtype in LARGE_TYPES


class Message(NamedTuple):
    """A message ready for publishing.

    Attributes:
        outlet: Index of its topic in Program.channels.
        stamp_ns: Nanoseconds since 1970.
        data: CDR with its encapsulation header; empty if it was not made because its topic is on
            demand and has no subscriber.
        key: Identifies the content; a message with the key of the topic's last one is skipped.
    """

    outlet: int
    stamp_ns: int
    data: bytes
    key: Hashable = None


class Program(Protocol):
    """Messages by position; fetch may be called from `workers` threads at once.

    Attributes:
        name: Display name.
        outlets: The topics.
        stamps_ns: (N,) int64 nanoseconds, ascending.
        frames: (N,) int64 frame numbers, never decreasing.
        workers: Number of threads that may fetch at once.
        typestore: Contains the types of the outlets.
        losses: Data missing from the start or found missing since, one line each.
    """

    name: str
    outlets: Sequence[Outlet]
    stamps_ns: Int64Array
    frames: Int64Array
    workers: int
    typestore: Typestore

    @property
    def losses(self) -> tuple[str, ...]:
        """Missing data, one line each."""

    def notes(self) -> tuple[str, ...]:
        """Return non-fatal remarks so far."""

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        """Return the messages at a position, and the losses: messages that could not be made.

        Args:
            index: 0 .. N-1.
            wanted: The outlets with a subscriber; on-demand messages of other outlets are not made
                and have no data.
        """

    def latched_before(self, index: int) -> list[Message]:
        """Return the last messages before a position of each latched topic."""

    def close(self) -> None:
        """Release files."""


class RecordingProgram:
    """The program of a KITTI recording: each sample is read and encoded when it is fetched.

    Raises:
        UsageError: The selection matches nothing.
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
        latched = {row.stream for row in self._encoder.table if row.latched}
        self._latched = [  # the positions of the entries of each stream with a latched topic
            np.flatnonzero(schedule.streams == code)
            for code, stream in enumerate(Stream)
            if stream in latched
        ]
        self._recording = recording
        self.name = f'{recording.layout.value} {recording.name}'
        self.channels: Sequence[Outlet] = [
            Outlet(row.topic, row.msgtype, row.latched, row.depth) for row in self._encoder.table
        ]
        self.stamps_ns = schedule.stamps_ns
        self.frames = schedule.frame_numbers
        self.workers = workers
        self.typestore: Typestore = TYPESTORE
        self._losses = self._encoder.concerned(recording.losses)
        self._named: set[str] = set()
        self._unsent: dict[str, str] = {}

    @property
    def losses(self) -> tuple[str, ...]:
        """Data missing from the start, and what passes over many samples could not read."""
        late = {
            loss.text(): f'{loss.stream}: {loss.text()}' for loss in self._recording.late_losses
        }
        late |= self._unsent
        unnamed = [text for reason, text in late.items() if reason not in self._named]
        return (*(f'{loss.stream}: {loss.text()}' for loss in self._losses), *unnamed)

    def notes(self) -> tuple[str, ...]:
        """See Program."""
        return (*self._recording.notes, *self._encoder.notes())

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        """See Program."""
        due, failures = self._encode(index, wanted)
        self._named.update(describe_error(each.error) for each in failures)
        return due, list(map(_loss, failures))

    def _encode(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Failure]]:
        entry = self._entries[index]
        messages, failures = self._encoder.encode(entry, wanted)
        due = [Message(each.topic, each.stamp_ns, join(each.parts), each.key) for each in messages]
        # Small messages first: each waits for those before it.
        due.sort(key=lambda each: self.channels[each.channel].on_demand)
        unmade = self._encoder.left_out(entry.stream, wanted)
        return [*due, *(Message(outlet, entry.stamp_ns, b'') for outlet in unmade)], failures

    def latched_before(self, index: int) -> list[Message]:
        """See Program."""
        last: dict[int, list[Message]] = {}
        for positions in self._latched:
            past = int(np.searchsorted(positions, index)) - 1
            if past < 0:
                continue
            messages, failures = self._encode(int(positions[past]), ())
            for each in failures:
                self._unsent[describe_error(each.error)] = _loss(each).message
            for message in messages:
                if self.channels[message.channel].latched:
                    last.setdefault(message.channel, []).append(message)
        return [message for messages in last.values() for message in messages]

    def close(self) -> None:
        """Do nothing: no file stays open between two samples."""


def _loss(failure: Failure) -> Loss:
    topics = ', '.join(failure.topics)
    return Loss(topics, len(failure.topics), f'{topics}: {describe_error(failure.error)}')
