# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of a plan's frames -> files, each when its message is read; and the report."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.errors import KittiRos2Error
from ..model.streams import Stream
from .frames import Frames, frame_topics
from .frames_at import UnknownPlaceError
from .label_messages import LabelMessages
from .report import ImportReport, LossTally, unread
from .set_notes import set_notes
from .stream_gaps import unit_losses
from .sync import NONE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from ..bags.decoding import Decoder
    from ..bags.reader import BagMessage
    from ..model.losses import Loss
    from ..rig.pose_track import Track
    from .excerpt import Excerpt
    from .oxts_stream import PacketMaker
    from .sample_writer import SampleWriter
    from .survey import Survey


@dataclass(frozen=True)
class SampleJob:
    """A sample to be worked out and written: write returns the bytes it wrote.

    Attributes:
        stream, number, topic: The stream, the frame, and the topic of the message.
        stamp_ns: The log time of the message.
        write: Writes the sample.
    """

    stream: Stream
    number: int
    topic: str
    stamp_ns: int
    write: Callable[[], int]


@dataclass(frozen=True)
class Target:
    """A data set to build.

    Attributes:
        stage: Its folder.
        first: The number of the first frame.
        frames: Its frames, None to choose them.
        without: Streams that are placed there from another set.
        excerpt: The few frames to convert, None for all; only what they need is read.
    """

    stage: Path
    first: int = 0
    frames: Frames | None = None
    without: frozenset[Stream] = frozenset()
    excerpt: Excerpt | None = None


def carry_out(job: SampleJob) -> tuple[SampleJob, int | Exception]:
    """Write a sample; return the bytes written, or why it was not."""
    try:
        return job, job.write()
    except (ValueError, KittiRos2Error) as error:
        return job, error


class SetBuilder:
    """Writes the samples of the frames of a data set, in the order in which they are read.

    Attributes:
        counts: Files, or lines of a common file, by stream.
        size_bytes: Of the files with samples so far.
    """

    def __init__(
        self, samples: SampleWriter, packets: PacketMaker, target: Target, losses: LossTally
    ) -> None:
        """Take the parts of a conversion.

        Args:
            samples: Writes the samples.
            packets: Makes the packets of oxts.
            target: The data set.
            losses: Takes the messages that cannot be used.
        """
        plan, frames, accepts = samples.plan, samples.frames, samples.writer.accepts
        self._samples = samples
        self._packets = packets
        self._target = target
        self._losses = losses
        self._streams: dict[str, list[Stream]] = defaultdict(list)
        for stream, topic in frame_topics(plan).items():
            if stream in accepts - {Stream.LABELS} and stream not in target.without:
                self._streams[topic].append(stream)
        labelled = Stream.LABELS in accepts and Stream.LABELS not in target.without
        self._labels = LabelMessages(plan.labels if labelled else None, frames, target.first)
        self._numbers = {
            stream: _numbers(frames.samples[stream], target.first)
            for streams in self._streams.values()
            for stream in streams
        }
        self.counts: Counter[str] = Counter()
        self.size_bytes = 0

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return set(self._streams) | self._labels.topics | self._packets.topics

    def write_calibration(self) -> None:
        """Write the calibration of every frame, or of all."""
        self.counts[Stream.CALIBRATION.value] = self._samples.write_calibration()

    def jobs(
        self, messages: Iterable[tuple[int, BagMessage]], decode: Decoder
    ) -> Iterator[SampleJob]:
        """Yield the files of the samples in frames, in the order of reading.

        Args:
            messages: Each with its place in its topic.
            decode: By the types of their bags.
        """
        for place, message in messages:
            wanted = [
                (stream, self._numbers[stream][place])
                for stream in self._streams.get(message.topic, ())
                if place in self._numbers[stream]
            ]
            labelled = self._labels.frames_of(message.topic, place)
            packet = self._packets.wants(message.topic, place)
            if not wanted and not labelled and not packet:
                continue
            try:
                decoded = decode(message)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
                self._spoil([*(number for _, number in wanted), *labelled])
                decoded = None
            if packet:
                self._packets.take(message.topic, place, decoded)
                self.write_packets()
            for number, solid, flat in self._labels.take(message.topic, place, decoded):
                self._take_labels(number, solid, flat, message.stamp_ns)
            if decoded is None:
                continue
            for stream, number in wanted:
                yield self._job(stream, number, place, message, decoded)
        # An excerpt has one message of each frame.
        for number, solid, flat in self._labels.rest():
            self._take_labels(number, solid, flat, 0)

    def write_packets(self) -> None:
        """Write the packets that are complete."""
        self.counts[Stream.OXTS.value] += self._packets.write(
            self._samples.writer, self._target.first
        )

    def _job(
        self,
        stream: Stream,
        number: int,
        place: int,
        message: BagMessage,
        decoded: Any,  # noqa: ANN401 - of the bag's types
    ) -> SampleJob:
        samples, topic = self._samples, message.topic
        if stream is Stream.SCAN:
            write = partial(samples.write_scan, number, topic, place, decoded)
        else:
            write = partial(samples.write_image, stream.camera or 0, number, topic, place, decoded)
        return SampleJob(stream, number, topic, message.stamp_ns, write)

    def _take_labels(self, number: int, solid: list[Any], flat: list[Any], log_ns: int) -> None:
        """Write labels in order and at once: tracks are numbered as they appear."""
        topic = frame_topics(self._samples.plan)[Stream.LABELS]
        write = partial(self._samples.write_labels, number, solid, flat)
        self.take(*carry_out(SampleJob(Stream.LABELS, number, topic, log_ns, write)))

    def take(self, job: SampleJob, outcome: int | Exception) -> None:
        """Count a sample by its outcome: the bytes written, or an error."""
        if isinstance(outcome, Exception):
            at_ns = outcome.stamp_ns if isinstance(outcome, UnknownPlaceError) else job.stamp_ns
            self._losses.lose(job.topic, at_ns, str(outcome))
            self._spoil([job.number])
            return
        self.counts[job.stream.value] += 1
        self.size_bytes += outcome

    def _spoil(self, numbers: Any) -> None:  # noqa: ANN401 - an iterable of numbers
        """Exclude frames with a missing sample from the lists of frames."""
        for number in numbers:
            self._samples.writer.leave_out(number)

    def write_poses(self, track: Track) -> None:
        """Write the poses of the frames, each of which must have one."""
        self.counts[Stream.POSE.value] = self._samples.write_poses(track)

    def report(self, survey: Survey, damaged: tuple[Loss, ...]) -> ImportReport:
        """Return the report of the conversion, after the writer is closed."""
        plan, frames, riggings = self._samples.plan, self._samples.frames, self._samples.riggings
        notes = [*survey.notes, *frames.notes, *riggings.notes(), *self._packets.notes()]
        notes += self._samples.notes()
        if not self._target.first and self._target.excerpt is None:
            files = self.counts[Stream.LABELS.value]
            notes += set_notes(plan, self._target.stage, files, self._samples.empty_labels)
        lost = self._losses.losses()
        undecoded = unread(survey, plan, {loss.stream for loss in lost})
        return ImportReport(
            layout=plan.layout,
            name=plan.name,
            counts={name: count for name, count in self.counts.items() if count},
            frames=len(frames),
            size_bytes=self.size_bytes,
            losses=(
                *damaged,
                *undecoded,
                *lost,
                *frames.losses,
                *unit_losses(survey, plan, frames.stamps_ns),
                *self._packets.losses,
                *riggings.losses(),
            ),
            notes=tuple(notes),
        )


def _numbers(samples: Any, first: int) -> dict[int, int]:  # noqa: ANN401 - Int64Array
    """Map places in a topic to frame numbers."""
    frames = np.flatnonzero(samples != NONE)
    return dict(zip(samples[frames].tolist(), (frames + first).tolist(), strict=True))
