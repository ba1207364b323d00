# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Encoding of a schedule on several cores: the messages of all samples, in order.

Threads share what releases the interpreter's lock: reading, inflating, decoding PNG, compressing.
The rest, a quarter of the time for decoded images and most of it for passing PNG through, is
Python's own. Processes share that too: each encodes runs of consecutive samples, and returns their
messages through shared memory. Only the messages of a few runs exist at a time, however long the
recording is. What depends on order stays with the one who takes the messages: which of them repeat
the last one, and where a chunk or a file of the bag ends.
"""

from __future__ import annotations

from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pickle import PickleBuffer
from typing import TYPE_CHECKING, TypeAlias

from ..files.opencv_threads import one_opencv_thread
from ..files.processes import can_fork, forked
from ..files.workers import hold_to_one_thread, ordered_map, worker_count
from .remarks import Remarks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from ..messages.cdr import Message, Parts
    from ..model.losses import Loss
    from ..model.recording import ReadableRecording
    from .encode import Encoder
    from .schedule import Schedule

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
        remarks: On the samples that this process has encoded since its last run.
        late_losses: All those of its recording so far.
    """

    outcomes: list[Outcome]
    remarks: Remarks
    late_losses: tuple[Loss, ...]


class RunEncoder:
    """Encodes runs of consecutive samples.

    Args:
        encoder: Of the samples.
        recording: Their recording.
        schedule: The samples.
    """

    def __init__(self, encoder: Encoder, recording: ReadableRecording, schedule: Schedule) -> None:
        self._encoder = encoder
        self._recording = recording
        self._schedule = schedule

    def __call__(self, start: int) -> EncodedRun:
        """Encode the run that begins at a position of the schedule, in a process for this alone."""
        hold_to_one_thread()
        encoder = self._encoder
        encoder.remarks = Remarks()
        outcomes = [
            ([message._replace(parts=_buffers(message.parts)) for message in messages], losses)
            for messages, losses in map(encoder.encode, self._schedule.part(start, start + _RUN))
        ]
        return EncodedRun(outcomes, encoder.remarks, tuple(self._recording.late_losses))


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
        encoder: Of the samples.
        recording: Their recording.
        schedule: The samples.
        decodes: Whether images are decoded, which is long enough to share it out.
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
    with ExitStack() as stack:
        with one_opencv_thread(imported=decodes):
            starts = range(0, len(schedule), _RUN)
            runs = stack.enter_context(forked(encode_run, starts, jobs, _SLOT_BYTES))
        late = dict.fromkeys(recording.late_losses)
        yield EncodedSamples(_outcomes(runs, encoder, late), lambda: late)


def _outcomes(
    runs: Iterable[EncodedRun], encoder: Encoder, late: dict[Loss, None]
) -> Iterator[Outcome]:
    for run in runs:
        encoder.remarks.add(run.remarks)
        late.update(dict.fromkeys(run.late_losses))
        yield from run.outcomes


def _buffers(parts: Parts) -> Parts:
    """Return the parts of a message for pickle: the large ones are buffers, not copied here."""
    return tuple(
        bytes(part) if len(part) < _BUFFERED_FROM else PickleBuffer(memoryview(part).toreadonly())  # type: ignore[misc]
        for part in parts
    )
