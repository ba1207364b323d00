# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of KITTI to a bag: one chronological pass, each sample read when due.

With several jobs, processes encode the samples.
"""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass
from pickle import PickleBuffer
from typing import TYPE_CHECKING, TypeAlias

from ..bags.writer import guess_storage, open_bag
from ..files.processes import can_fork, forked, one_opencv_thread
from ..files.threads import limit_to_one_thread, ordered_map, worker_count
from ..messages.cdr import LastKeys
from ..messages.ros_types import TYPESTORE
from ..model.errors import KittiRos2Error, Loss
from ..options.messages import Clouds
from .encode import Encoder, SampleNotes
from .schedule import make_schedule

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from contextlib import AbstractContextManager
    from pathlib import Path

    from ..bags.writer import BagWriter
    from ..messages.cdr import Message, Parts
    from ..messages.topics import Topic
    from ..model.recording import ReadableRecording
    from ..options.messages import MessageOptions
    from ..options.outputs import BagOptions
    from ..options.read import SelectionOptions
    from ..options.table import Settings
    from .schedule import Schedule


# Encoding of a schedule on several cores: the messages of all samples, in order.
#
# Threads share what releases the interpreter's lock: reading, inflating, decoding PNG, compressing.
# The rest, a quarter of the time for decoded images and most of it for passing PNG through, is
# Python's own. Processes share that too: each encodes runs of consecutive samples, and returns
# their messages through shared memory. Only the messages of a few runs exist at a time, however
# long the recording is. The consumer of the messages decides what depends on order: which of
# them repeat the last one, and where a chunk or a file of the bag ends.

if TYPE_CHECKING:
    Outcome: TypeAlias = tuple[list[Message], list[Loss]]

_RUN = 8  # samples, about a frame
_SLOT_BYTES = 16 * 2**20  # a frame of four decoded images and its scan takes 9 MB
_BUFFERED_FROM = 4096
"""Below this size in bytes, a message is pickled as it is."""


@dataclass(frozen=True)
class EncodedRun:
    """The result of encoding consecutive samples; it can be pickled, by protocol 5 without copies.

    Attributes:
        outcomes: Messages and losses of each sample.
        sample_notes: Notes on the samples that this process has encoded since its last run.
        late_losses: All those of its recording so far.
    """

    outcomes: list[Outcome]
    sample_notes: SampleNotes
    late_losses: tuple[Loss, ...]


class RunEncoder:
    """Encodes runs of consecutive samples.

    Args:
        encoder: Encoder of the samples.
        recording: Their recording.
        schedule: The samples.
    """

    def __init__(self, encoder: Encoder, recording: ReadableRecording, schedule: Schedule) -> None:
        self._encoder = encoder
        self._recording = recording
        self._schedule = schedule

    def __call__(self, start: int) -> EncodedRun:
        """Encode the run that begins at a position of the schedule, in a process for this alone."""
        limit_to_one_thread()
        encoder = self._encoder
        encoder.sample_notes = SampleNotes()
        outcomes = [
            ([message._replace(parts=_buffers(message.parts)) for message in messages], losses)
            for messages, losses in map(encoder.encode, self._schedule.part(start, start + _RUN))
        ]
        return EncodedRun(outcomes, encoder.sample_notes, tuple(self._recording.late_losses))


@dataclass(frozen=True)
class EncodedSamples:
    """The encoding of all samples, in progress.

    Attributes:
        outcomes: Messages and losses of each sample, in order.
        late_losses: Returns the losses of passes over many samples so far; see model.recording.
    """

    outcomes: Iterator[Outcome]
    late_losses: Callable[[], Iterable[Loss]]


@contextmanager
def encoding(
    encoder: Encoder,
    recording: ReadableRecording,
    schedule: Schedule,
    *,
    decodes: bool,
    jobs: int = 1,
) -> Iterator[EncodedSamples]:
    """Encode all samples in order, on several cores; what encodes ends with the context.

    Args:
        encoder: Encoder of the samples.
        recording: Their recording.
        schedule: The samples.
        decodes: Whether images are decoded or scans rounded, which is long enough to share it out.
        jobs: Number of worker processes, which start at once; 1: none. Outside of Linux, and in a
            program with threads, which cannot be forked, threads take their place.

    Raises:
        KittiRos2Error: By the iterator: a worker process was killed.
    """
    if jobs == 1 or not can_fork():
        workers, batch = (worker_count(), 1) if decodes else (1, _RUN)
        outcomes = ordered_map(encoder.encode, schedule, workers, batch)
        with closing(outcomes):
            yield EncodedSamples(outcomes, lambda: recording.late_losses)
        return
    encode_run = RunEncoder(encoder, recording, schedule)
    with ExitStack() as exit_stack:
        with one_opencv_thread(imported=decodes):
            starts = range(0, len(schedule), _RUN)
            runs = exit_stack.enter_context(forked(encode_run, starts, jobs, _SLOT_BYTES))
        late = dict.fromkeys(recording.late_losses)
        yield EncodedSamples(_outcomes(runs, encoder, late), lambda: late)


def _outcomes(
    runs: Iterable[EncodedRun], encoder: Encoder, late: dict[Loss, None]
) -> Iterator[Outcome]:
    for run in runs:
        encoder.sample_notes.add(run.sample_notes)
        late.update(dict.fromkeys(run.late_losses))
        yield from run.outcomes


def _buffers(parts: Parts) -> Parts:
    """Return the parts of a message for pickle: the large ones are buffers, not copied here."""
    return tuple(
        bytes(part) if len(part) < _BUFFERED_FROM else PickleBuffer(memoryview(part).toreadonly())  # type: ignore[misc]
        for part in parts
    )


# Conversion of KITTI to a bag: one chronological pass, each sample read when due.

ShowProgress: TypeAlias = 'Callable[[int, int], AbstractContextManager[Callable[[int, int], None]]]'


@dataclass(frozen=True)
class ExportOptions:
    """Options of a conversion.

    Attributes:
        messages: Topics and encodings.
        selection: The part of the recording to convert.
        bag: Container, compression, splitting.
        strict: Stop at the first loss, and remove the output.
    """

    messages: MessageOptions
    selection: SelectionOptions
    bag: BagOptions
    strict: bool = False

    @classmethod
    def of(cls, settings: Settings, out: Path) -> ExportOptions:
        """Take the options from the settings of to-bag; OUT may name the container.

        Raises:
            UsageError: An option is invalid for the container.
        """
        bag = settings.bag(guess_storage(out, settings.storage))
        return cls(settings.messages, settings.selection, bag, settings.strict)


@dataclass(frozen=True)
class ExportReport:
    """The result of a conversion.

    Attributes:
        path: The bag.
        counts: Messages by topic.
        frames: Number of scheduled frames; see streams.FRAME_STREAMS.
        size_bytes: Bytes of all messages.
        first_ns, last_ns: Stamps.
        losses: Skipped data.
        notes: Notes, a line each.
    """

    path: Path
    counts: dict[str, int]
    frames: int
    size_bytes: int
    first_ns: int
    last_ns: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def convert(
    recording: ReadableRecording,
    out: Path,
    options: ExportOptions,
    *,
    progress: ShowProgress = lambda _samples, _frames: nullcontext(lambda _done, _bytes: None),
    jobs: int = 1,
) -> ExportReport:
    """Write a recording to a bag.

    Args:
        recording: The source.
        out: The bag: a name ending in .mcap or .bag, or that of a rosbag2 directory.
        options: Options of the conversion.
        progress: Called with the number of samples and frames; returns a context with a function
            that is called with the samples done and the bytes written so far.
        jobs: Number of worker processes that encode; 1: none, but threads. The bag is the same.

    Raises:
        UsageError: The selection is empty, or an option is invalid for the output.
        KittiRos2Error: With strict, the first loss; or a worker process was killed.
        OutputError: The output cannot be written.
        OutputExistsError: The output exists and the options do not overwrite.
    """
    schedule = make_schedule(recording, options.selection)
    encoder = Encoder(recording, schedule, options.messages, options.selection)
    tally = _ExportTally(strict=options.strict)
    for loss in encoder.concerned(recording.losses):
        tally.lose(loss)
    source = {'layout': recording.layout.value, 'name': recording.name}
    messages = options.messages
    decodes = messages.decodes_images or messages.clouds is Clouds.COMPACT
    threads = max(worker_count(), jobs)
    with (
        # Before the others: a fork inherits open files and locks.
        encoding(encoder, recording, schedule, decodes=decodes, jobs=jobs) as encoded,
        progress(len(schedule), schedule.frames) as show,
        open_bag(out, options.bag, TYPESTORE, source_metadata=source, threads=threads) as writer,
    ):
        channels = _Channels(writer, encoder.table)
        for done, outcome in enumerate(encoded.outcomes, 1):
            tally.take(*outcome, channels)
            show(done, tally.size_bytes)
        for loss in encoded.late_losses():
            tally.lose_unnamed(loss)
    return ExportReport(
        path=writer.path,
        counts={row.topic: tally.counts[index] for index, row in enumerate(encoder.table)},
        frames=schedule.frames,
        size_bytes=tally.size_bytes,
        first_ns=int(schedule.stamps_ns[0]),
        last_ns=int(schedule.stamps_ns[-1]),
        losses=tally.losses(),
        notes=tuple(recording.notes) + encoder.notes(),
    )


class _Channels:
    """The topics of a bag, each declared with its first message, so that none is empty."""

    def __init__(self, writer: BagWriter, table: list[Topic]) -> None:
        self._writer = writer
        self._table = table
        self._ids: dict[int, int] = {}

    def write(self, message: Message) -> None:
        """Write a message to its topic."""
        index = message.channel
        if index not in self._ids:
            self._ids[index] = self._writer.add_channel(self._table[index])
        self._writer.write(self._ids[index], message.stamp_ns, message.parts)


class _ExportTally:
    """Writes messages in order; counts messages and losses."""

    def __init__(self, *, strict: bool) -> None:
        self.counts: Counter[int] = Counter()
        self.size_bytes = 0
        self._strict = strict
        self._losses: Counter[tuple[str, str]] = Counter()
        self._last_keys = LastKeys()

    def take(self, messages: list[Message], losses: list[Loss], channels: _Channels) -> None:
        """Write messages, except repeated ones; count losses."""
        for loss in losses:
            self.lose(loss)
        for message in messages:
            if self._last_keys.repeats(message.channel, message.key):
                continue
            channels.write(message)
            self.counts[message.channel] += 1
            self.size_bytes += sum(map(len, message.parts))

    def lose(self, loss: Loss) -> None:
        """Count a loss; with strict, stop at it."""
        if self._strict:
            raise KittiRos2Error(f'{loss.text()}; stopped there because of --strict')
        self._losses[loss.stream, loss.text()] += loss.count

    def lose_unnamed(self, loss: Loss) -> None:
        """Count a loss, unless one for the same reason was already counted."""
        if not any(text == loss.text() for _, text in self._losses):
            self.lose(loss)

    def losses(self) -> tuple[Loss, ...]:
        """Return all losses, counted by stream and reason."""
        return tuple(Loss(stream, n, message) for (stream, message), n in self._losses.items())
