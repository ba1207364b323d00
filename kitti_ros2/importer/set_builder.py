# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of a plan's frames -> files, each when its message is read; and the report."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.errors import KittiRos2Error
from ..model.streams import Stream
from .calibration_source import is_extract
from .convert_scans import dropped_notes
from .depth_maps import DepthMaps
from .frames import Frames, frame_topics
from .label_messages import LabelMessages, joined
from .pose_track import camera_poses
from .report import ImportReport, LossTally, unread
from .set_notes import set_notes
from .stream_gaps import unit_losses
from .sync import NONE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from ..bags.decoding import Decoder
    from ..bags.reader import BagMessage
    from ..kitti.writer import LayoutWriter
    from ..model.losses import Loss
    from ..rig.pose_track import Track
    from .apply_calibration import Rigging
    from .excerpt import Excerpt
    from .oxts_stream import PacketMaker
    from .plan import Plan
    from .survey import Survey


@dataclass(frozen=True)
class SampleJob:
    """A sample to be worked out and written: write returns the bytes it wrote."""

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
        self,
        plan: Plan,
        frames: Frames,
        rigging: Rigging,
        packets: PacketMaker,
        writer: LayoutWriter,
        target: Target,
        losses: LossTally,
    ) -> None:
        """Take the parts of a conversion.

        Args:
            plan: The rules.
            frames: Those to write.
            rigging: Converts messages to samples.
            packets: Makes the packets of oxts.
            writer: Of the layout.
            target: The data set.
            losses: Takes the messages that cannot be used.
        """
        self._plan = plan
        self._frames = frames
        self._rigging = rigging
        self._writer = writer
        self._target = target
        self._first = target.first
        self._streams: dict[str, list[Stream]] = defaultdict(list)
        for stream, topic in frame_topics(plan).items():
            if stream in writer.accepts - {Stream.LABELS} and stream not in target.without:
                self._streams[topic].append(stream)
        labelled = Stream.LABELS in writer.accepts and Stream.LABELS not in target.without
        self._labels = LabelMessages(plan.labels if labelled else None, frames, target.first)
        self._numbers = {
            stream: _numbers(frames.samples[stream], target.first)
            for streams in self._streams.values()
            for stream in streams
        }
        self._packets = packets
        self._depth_maps = DepthMaps(plan, rigging, writer, unrectified=is_extract(plan))
        self._losses = losses
        self._lock = Lock()  # scans are written by several threads
        self._points_dropped: Counter[str] = Counter()
        self.counts: Counter[str] = Counter()
        self.size_bytes = 0
        self._empty_labels = 0

    @property
    def topics(self) -> set[str]:
        """The topics to read."""
        return set(self._streams) | self._labels.topics | self._packets.topics

    def write_calibration(self) -> None:
        """Write the calibration of every frame, or of all."""
        stamps_ns = self._frames.stamps_ns.tolist()
        if not self._plan.layout.traits.calibration_per_frame:
            del stamps_ns[1:]
        for number, stamp_ns in enumerate(stamps_ns):
            calibration = self._rigging.calibrations.at(stamp_ns)
            if calibration is not None:
                self._writer.write_calibration(self._first + number, calibration)
                self.counts[Stream.CALIBRATION.value] += 1

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
        self.counts[Stream.OXTS.value] += self._packets.write(self._writer, self._first)

    def _job(
        self,
        stream: Stream,
        number: int,
        place: int,
        message: BagMessage,
        decoded: Any,  # noqa: ANN401 - of the bag's types
    ) -> SampleJob:
        stamp_ns = self._stamp_ns(message.topic, number, place)
        if stream is Stream.SCAN:
            own_ns = int(self._frames.stamps[message.topic][place])
            write = partial(self._write_scan, number, stamp_ns, own_ns, decoded)
        else:
            write = partial(self._write_image, stream.camera or 0, number, stamp_ns, decoded)
        return SampleJob(stream, number, message.topic, message.stamp_ns, write)

    def _stamp_ns(self, topic: str, number: int, place: int) -> int:
        """Return a sample's own stamp where the layout stores it, else the frame's."""
        if self._plan.layout.traits.stamps_per_stream:
            return int(self._frames.stamps[topic][place])
        return int(self._frames.stamps_ns[number - self._first])

    def _write_scan(self, number: int, stamp_ns: int, own_ns: int, cloud: Any) -> int:  # noqa: ANN401
        scan, dropped = self._rigging.scans.scan(cloud, own_ns)
        with self._lock:
            self._points_dropped.update(dropped)
        if not len(scan.points):
            reasons = ', '.join(reason for reason, count in dropped.items() if count)
            raise ValueError(f'no point is left of it: {reasons}' if reasons else 'it has no point')
        self._writer.write_scan(number, stamp_ns, scan)
        self._depth_maps.write(number, stamp_ns, scan.points)
        return scan.points.nbytes

    def _write_image(self, camera: int, number: int, stamp_ns: int, image: Any) -> int:  # noqa: ANN401
        png = self._rigging.images.png(camera, image)
        self._writer.write_image(camera, number, stamp_ns, png)
        return len(png)

    def _take_labels(self, number: int, solid: list[Any], flat: Any, log_ns: int) -> None:  # noqa: ANN401
        """Write labels in order and at once: tracks are numbered as they appear."""
        topic = frame_topics(self._plan)[Stream.LABELS]
        place = self._frames.samples[Stream.LABELS][number - self._first]
        own_ns = int(self._frames.stamps[topic][place])
        write = partial(self._write_labels, number, own_ns, solid, flat)
        self.take(*carry_out(SampleJob(Stream.LABELS, number, topic, log_ns, write)))

    def _write_labels(self, number: int, own_ns: int, solid: list[Any], flat: Any) -> int:  # noqa: ANN401
        stamp_ns = int(self._frames.stamps_ns[number - self._first])
        boxes = self._rigging.labels.boxes(joined(solid), stamp_ns, own_ns, flat)
        self._writer.write_labels(number, boxes)
        self._empty_labels += not boxes
        return 0

    def take(self, job: SampleJob, outcome: int | Exception) -> None:
        """Count a sample by its outcome: the bytes written, or an error."""
        if isinstance(outcome, Exception):
            self._losses.lose(job.topic, job.stamp_ns, str(outcome))
            self._spoil([job.number])
            return
        self.counts[job.stream.value] += 1
        self.size_bytes += outcome

    def _spoil(self, numbers: Any) -> None:  # noqa: ANN401 - an iterable of numbers
        """Exclude frames with a missing sample from the lists of frames."""
        for number in numbers:
            self._writer.leave_out(number)

    def write_poses(self, track: Track) -> None:
        """Write the poses of the frames, each of which must have one."""
        stamps_ns = self._frames.stamps_ns
        poses = camera_poses(track, stamps_ns, self._rigging.body_t_rect())
        known = [pose for pose in poses if pose is not None]
        for number, (stamp_ns, pose) in enumerate(zip(stamps_ns.tolist(), known, strict=True)):
            self._writer.write_pose(number, stamp_ns, pose)
        self.counts[Stream.POSE.value] = len(known)

    def report(self, survey: Survey, damaged: tuple[Loss, ...]) -> ImportReport:
        """Return the report of the conversion, after the writer is closed."""
        notes = [*survey.notes, *self._frames.notes, *self._rigging.notes(), *self._packets.notes()]
        notes += self._depth_maps.notes()
        if self._plan.scan is not None:
            notes += dropped_notes(self._plan.scan.topic, self._points_dropped)
        if not self._first and self._target.excerpt is None:
            files = self.counts[Stream.LABELS.value]
            notes += set_notes(self._plan, self._target.stage, files, self._empty_labels)
        lost = self._losses.losses()
        undecoded = unread(survey, self._plan, {loss.stream for loss in lost})
        return ImportReport(
            layout=self._plan.layout,
            name=self._plan.name,
            counts={name: count for name, count in self.counts.items() if count},
            frames=len(self._frames),
            size_bytes=self.size_bytes,
            losses=(
                *damaged,
                *undecoded,
                *lost,
                *self._frames.losses,
                *unit_losses(survey, self._plan, self._frames.stamps_ns),
                *self._rigging.losses(),
            ),
            notes=tuple(notes),
        )


def _numbers(samples: Any, first: int) -> dict[int, int]:  # noqa: ANN401 - Int64Array
    """Map places in a topic to frame numbers."""
    frames = np.flatnonzero(samples != NONE)
    return dict(zip(samples[frames].tolist(), (frames + first).tolist(), strict=True))
