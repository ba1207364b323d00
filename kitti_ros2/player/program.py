# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A program: messages in order of time, accessible by position."""

from __future__ import annotations

import os
import sys
import threading
from collections import deque
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from itertools import islice
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..files.threads import deferred_signals
from ..messages.cdr import Message
from ..messages.ros_types import TYPESTORE
from ..model.errors import Loss
from ..model.streams import NS_PER_S, Clock, Stream
from ..own_bags.encode import Encoder
from ..own_bags.schedule import make_schedule

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence
    from concurrent.futures import Future

    from typing_extensions import Self

    from ..messages.ros_types import Typestore
    from ..model.bag_formats import Channel
    from ..model.recording import ReadableRecording
    from ..model.samples import Int64Array
    from ..model.streams import Layout
    from ..options.messages import MessageOptions
    from ..options.read import SelectionOptions


_LONGEST_GAP_NS = NS_PER_S


class Program(Protocol):
    """Messages by position; fetch may be called from `workers` threads at once.

    Attributes:
        name: Display name.
        channels: The topics that are played.
        stamps_ns: (N,) int64 nanoseconds, ascending.
        frames: (N,) int64 frame numbers, each frame in one piece.
        longest_gap_ns: Longest wait between messages, nanoseconds; None is any.
        workers: Number of threads that may fetch at once.
        typestore: Contains the types of the channels.
        losses: Data missing from the start or found missing since, one line each.
    """

    name: str
    channels: Sequence[Channel]
    stamps_ns: Int64Array
    frames: Int64Array
    longest_gap_ns: int | None
    workers: int
    typestore: Typestore

    @property
    def losses(self) -> tuple[str, ...]:
        """Missing data, one line each."""

    def notes(self) -> tuple[str, ...]:
        """Return the notes so far."""

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        """Return the messages at a position, and the losses: messages that could not be made.

        Args:
            index: 0 .. N-1.
            wanted: The channels with a subscriber; on-demand messages of others are not made
                and have no data.
        """

    def latched_before(self, index: int) -> list[Message]:
        """Return the last messages before a position of each latched topic."""

    def close(self) -> None:
        """Release files."""


def longest_gap_ns(layout: Layout, clock: Clock) -> int | None:
    """Return the longest wait between messages: frames of a set in real time are days apart."""
    return _LONGEST_GAP_NS if layout.traits.frame_set and clock is Clock.UTC else None


class RecordingProgram:
    """The program of a KITTI recording: each sample is read and encoded when it is fetched.

    Raises:
        UsageError: The selection matches nothing.
    """

    def __init__(
        self,
        recording: ReadableRecording,
        messages: MessageOptions,
        selection: SelectionOptions,
        workers: int,
    ) -> None:
        schedule = make_schedule(recording, selection)
        self._encoder = Encoder(recording, schedule, messages, selection)
        self._entries = list(schedule)
        latched = {row.stream for row in self._encoder.table if row.latched}
        self._latched = {  # the positions of the entries of each stream with a latched topic
            stream: np.flatnonzero(schedule.streams == code)
            for code, stream in enumerate(Stream)
            if stream in latched
        }
        self._recording = recording
        self.name = f'{recording.layout.value} {recording.name}'
        self.channels: Sequence[Channel] = self._encoder.table
        self.stamps_ns = schedule.stamps_ns
        self.frames = schedule.frame_numbers
        self.longest_gap_ns = longest_gap_ns(recording.layout, recording.clock)
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
        messages, losses = self._encode(index, wanted)
        self._named.update(loss.message for loss in losses)
        return messages, list(_by_reason(losses).values())

    def _encode(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        entry = self._entries[index]
        encoded, losses = self._encoder.encode(entry, wanted)
        messages = [
            message if len(message.parts) == 1 else message._replace(parts=(message.data,))
            for message in encoded
        ]
        # Small messages first: each waits for those before it.
        messages.sort(key=lambda message: self._encoder.table[message.channel].on_demand)
        unmade = self._encoder.left_out(entry.stream, wanted)
        return messages + [Message(index, entry.stamp_ns, ()) for index in unmade], losses

    def latched_before(self, index: int) -> list[Message]:
        """See Program."""
        last: dict[int, list[Message]] = {}
        for positions in self._latched.values():
            past = int(np.searchsorted(positions, index)) - 1
            if past < 0:
                continue
            messages, losses = self._encode(int(positions[past]), ())
            for reason, loss in _by_reason(losses).items():
                self._unsent[reason] = loss.message
            for message in messages:
                if self.channels[message.channel].latched:
                    last.setdefault(message.channel, []).append(message)
        return [message for messages in last.values() for message in messages]

    def close(self) -> None:
        """Do nothing: no file stays open between two samples."""


def _by_reason(losses: Iterable[Loss]) -> dict[str, Loss]:
    """Return one loss for each reason, whose message begins with the topics concerned."""
    topics: dict[str, list[str]] = {}
    for loss in losses:
        topics.setdefault(loss.message, []).append(loss.stream)
    return {
        reason: Loss(', '.join(names), len(names), f'{", ".join(names)}: {reason}')
        for reason, names in topics.items()
    }


# Prefetches messages on a pool of threads, so that publishing does not wait for them.

if TYPE_CHECKING:
    Fetched = tuple[list[Message], list[Loss]]


_NICENESS = 10


class ReadAhead:
    """Prefetches a bounded number of samples of a program; for one consuming thread.

    In the main thread, signals wait until a method has ended: see files.threads.

    At the end it continues at the beginning: a loop has no gap; a single pass wastes a few samples.

    Args:
        program: The program.
        samples: Number of samples to prefetch.
        polite: Whether the threads run at a lower priority.
    """

    def __init__(self, program: Program, samples: int, *, polite: bool) -> None:
        self._program = program
        self._total = len(program.stamps_ns)
        self._size = max(1, min(samples, self._total))
        self._pool = ThreadPoolExecutor(
            program.workers,
            thread_name_prefix='read-ahead',
            initializer=_step_back if polite else None,
        )
        self._ahead: deque[_Sample] = deque()
        self._next = 0
        self._wanted: frozenset[int] = frozenset()

    def __enter__(self) -> Self:
        return self

    @deferred_signals()
    def __exit__(self, *_: object) -> None:
        self._drop()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def want(self, wanted: frozenset[int], *, at_once: bool = True) -> None:
        """Set the outlets with subscribers; samples fetched without a new one are fetched again.

        Args:
            wanted: The outlets.
            at_once: Whether the next sample is made for them, though it may be late. If not, those
                that are there are taken until they are fetched again: a new subscriber, which
                always comes in between, does not hold up all others.
        """
        added = wanted - self._wanted
        self._wanted = wanted
        if added:
            self._fetch_again(at_once=at_once)

    @deferred_signals()
    def _fetch_again(self, *, at_once: bool) -> None:
        if at_once:
            self._drop()
        for number, sample in enumerate(self._ahead):
            sample.fetch_again(self._fetch(number))

    @deferred_signals()
    def prepare(self, position: int, samples: int) -> None:
        """Wait until samples from a position on are there, within the limit.

        An error of one comes when it is taken.
        """
        self._go_to(position)
        samples = min(samples, self._size)
        while len(self._ahead) < samples:
            self._submit()
        for sample in islice(self._ahead, samples):
            sample.wait()

    @deferred_signals()
    def take(self, position: int) -> Fetched:
        """Return the messages at a position; continue prefetching from there."""
        self._go_to(position)
        self._next = (position + 1) % self._total
        return self._ahead.popleft().result()

    def _go_to(self, position: int) -> None:
        """Forget what is ahead, unless that is the sample at a position, and fetch this."""
        if position != self._next:
            self._drop()
            self._next = position
        if not self._ahead:
            self._submit()

    @deferred_signals()
    def refill(self) -> None:
        """Start prefetching up to the limit."""
        while len(self._ahead) < self._size:
            self._submit()

    def low(self) -> bool:
        """Return whether less than half of the limit is prefetched."""
        return len(self._ahead) * 2 < self._size

    def _submit(self) -> None:
        self._ahead.append(_Sample(self._fetch(len(self._ahead))))

    def _fetch(self, number: int) -> Future[Fetched]:
        position = (self._next + number) % self._total
        return self._pool.submit(self._program.fetch, position, self._wanted)

    def _drop(self) -> None:
        for sample in self._ahead:
            sample.cancel()
        self._ahead.clear()


class _Sample:
    """A sample that is being fetched, perhaps again for more outlets."""

    def __init__(self, fetched: Future[Fetched]) -> None:
        self._fetched = fetched
        self._again: Future[Fetched] | None = None

    def fetch_again(self, future: Future[Fetched]) -> None:
        """Prefer another result, as soon as it is there."""
        if self._again is not None and not self._again.cancel():
            self._fetched = self._again
        if self._fetched.cancel():  # it has not begun
            self._fetched, self._again = future, None
        else:
            self._again = future

    def wait(self) -> None:
        """Wait until there is a result."""
        wait([self._fetched, *([self._again] if self._again else [])], return_when=FIRST_COMPLETED)

    def result(self) -> Fetched:
        """Return the result that is there, or wait for the first one."""
        if self._again is not None and self._again.done():
            return self._again.result()
        if self._again is not None:
            self._again.cancel()
        return self._fetched.result()

    def cancel(self) -> None:
        """Give up what has not begun."""
        self._fetched.cancel()
        if self._again is not None:
            self._again.cancel()


def _step_back() -> None:
    """Lower the priority of this thread; on Linux niceness is per thread."""
    if sys.platform == 'linux':
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
