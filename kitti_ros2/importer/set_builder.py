# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of a plan's frames -> files, each when its message is read; and the report."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.bag_files import path_of
from ..bags.reader import Decoder, open_messages
from ..files.image_files import encode_depth_map
from ..files.threads import ordered_map, worker_count
from ..kitti import names
from ..kitti.find import make_writer
from ..kitti.scan_grid import GridTally
from ..kitti.store import STORE
from ..kitti.writers import WriteOptions
from ..model.errors import KittiRos2Error, LossTally, UnsynchronisedError, damage
from ..model.geometry import Transform
from ..model.samples import NONE, rect_from_velo
from ..model.streams import PngForm, Stream
from .bag_labels import LabelMessages, merge_markers
from .bag_poses import read_motion
from .bag_scans import dropped_notes
from .bag_videos import BagVideos
from .clocks import clocked, oxts_losses
from .kitti_frames import (
    NO_FRAME,
    NO_PACKET,
    Frames,
    ImportReport,
    choose_frames,
    frame_topics,
    undecoded_losses,
    why_unposed,
    with_indices,
)
from .oxts_packets import PacketMaker
from .sensor_rig import SensorRigs
from .tf_frames import BoxTimes, UnknownTransformError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..bags.bag_files import BagSource
    from ..bags.reader import BagMessage
    from ..kitti.writers import LayoutWriter
    from ..messages.moving_tree import Track
    from ..model.errors import Loss
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, Float32Array, Int64Array
    from ..options.outputs import ImportOptions
    from .bag_videos import Outcome
    from .kitti_frames import Excerpt
    from .plan import Plan
    from .sensor_rig import SensorRig
    from .survey import Survey


# The vehicle's pose at each frame: a track of poses -> KITTI's camera poses.


def camera_poses(
    track: Track, frames_ns: Int64Array, body_t_cam0: Transform
) -> list[Float64Array | None]:
    """Convert the poses of a data set's frames to those of KITTI odometry.

    Args:
        track: Poses of the body in a fixed frame.
        frames_ns: (N,) stamps, nanoseconds.
        body_t_cam0: The rectified camera 0 in the body frame.

    Returns:
        For each frame (3, 4) float64: the rectified camera 0 in that of the first frame with a
        pose, metres; None without a pose.
    """
    poses = track.at(frames_ns)
    start = next((pose for pose in poses if pose is not None), None)
    if start is None:
        return [None] * len(poses)
    # Maps may be far from their origin (UTM); subtracting first keeps all digits.
    near = Transform.from_translation(-start.translation)
    # Not by transposes: calibrations of six digits are no exact rotations, and the first is 1.
    mount = body_t_cam0.matrix()
    first_cam0_t_near = np.linalg.inv((near @ start).matrix() @ mount)
    return [
        None if pose is None else (first_cam0_t_near @ (near @ pose).matrix() @ mount)[:3]
        for pose in poses
    ]


# Depth maps of scans that were made from depth images: each point in its pixel of a camera.
#
# As the sparse maps of KITTI's depth benchmark (velodyne_raw) they are the projections of the
# points, the nearest where several fall in a pixel. Where the depth image is registered to the
# camera's images, each pixel gets its own depth back.

_PER_M = 256.0
_DEEPEST = 65535


class DepthMaps:
    """Writes the depth maps of a recording; thread-safe.

    Attributes:
        folders: The folders of the maps, by camera; none unless the scans are of depth images.
    """

    def __init__(
        self, plan: Plan, sensors: SensorRig, writer: LayoutWriter, *, unrectified: bool
    ) -> None:
        has_maps = sensors.scans.are_depth and not unrectified and sensors.calibrations.values
        self._unrectified = sensors.scans.are_depth and unrectified
        self._writer = writer
        self.folders = {
            camera: writer.depth_folder(camera)
            for camera in sorted(plan.cameras)
            if has_maps and writer.depth_folder(camera) and sensors.images.size(camera)
        }

    def write(self, number: int, stamp_ns: int, points: Float32Array, sensors: SensorRig) -> None:
        """Write the maps of a scan, (N, 4) in velo_link, by the rig of its frame."""
        calibration = sensors.calibrations.at(stamp_ns)
        for camera in self.folders:
            size = sensors.images.size(camera)
            if calibration is not None and size is not None:
                pixels = make_depth_map(points, calibration, camera, size)
                self._writer.write_depth(camera, number, encode_depth_map(pixels))

    def notes(self) -> list[str]:
        """Return notes on the maps, or why none were written."""
        if self._unrectified:
            return ['no depth maps were written: the images of an extract are not rectified']
        return [
            f'{folder}: depth maps of camera {camera}, 16-bit PNG, metres * 256'
            for camera, folder in self.folders.items()
        ]


def make_depth_map(
    points: Float32Array, calibration: Calibration, camera: int, size: tuple[int, int]
) -> npt.NDArray[np.uint16]:
    """Return (H, W) depth times 256, metres, along the axis of a rectified camera; 0 without one.

    Args:
        points: (N, 4) x y z reflectance in velo_link.
        calibration: Contains the camera and the pose of the scanner.
        camera: KITTI index.
        size: (width, height) of its rectified image.
    """
    model = calibration.cameras[camera]
    seen = rect_from_velo(calibration) if model.cam_T_velo is None else model.cam_T_velo
    positions = seen.apply(points[:, :3].astype(np.float64))
    u, v, depth = (np.column_stack([positions, np.ones(len(positions))]) @ model.p_rect.T).T
    ahead = depth > 0
    column, row = (np.round(coordinate[ahead] / depth[ahead]) for coordinate in (u, v))
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    levels = np.clip(np.round(depth[ahead][inside] * _PER_M), 1, _DEEPEST).astype(np.uint16)
    # The last write to a pixel stays: the nearest.
    order = np.argsort(-levels.astype(np.int64), kind='stable')
    depth_map = np.zeros((size[1], size[0]), dtype=np.uint16)
    pixels = row[inside].astype(np.intp)[order], column[inside].astype(np.intp)[order]
    depth_map[pixels] = levels[order]
    return depth_map


# Decoded messages of a plan's frames -> the files of their samples.


class SampleWriter:
    """Converts messages to samples and writes them; scans and images from several threads.

    Attributes:
        plan: The rules.
        frames: The frames to write.
        rigs: Convert messages to samples.
        writer: The writer of the layout.
        first: The number of the first frame.
        empty_labels: Number of frames without a box so far.
    """

    def __init__(
        self,
        plan: Plan,
        frames: Frames,
        rigs: SensorRigs,
        writer: LayoutWriter,
        first: int,
        options: ImportOptions,
    ) -> None:
        self._png = options.png or _png_form(plan)
        self._grid = GridTally(enabled=options.snap)
        self.plan = plan
        self.frames = frames
        self.rigs = rigs
        self.writer = writer
        self.first = first
        self.empty_labels = 0
        sensors = rigs.first
        labels_t_velo = sensors.labels.upright.frame_T_velo
        if labels_t_velo is not None:
            writer.set_label_frame(labels_t_velo)
        self._depth_maps = DepthMaps(plan, sensors, writer, unrectified=plan.is_extract)
        self._lock = Lock()  # for the counts of scans
        self._points_dropped: Counter[str] = Counter()

    def write_calibration(self) -> int:
        """Write the calibration of every frame, or of all; return how many were written."""
        count = 0
        stamps_ns = self.frames.stamps_ns.tolist()
        if not self.plan.layout.traits.calibration_per_frame:
            del stamps_ns[1:]
        for number, stamp_ns in enumerate(stamps_ns, self.first):
            calibration = self._sensors(number).calibrations.at(stamp_ns)
            if calibration is not None:
                self.writer.write_calibration(number, calibration)
                count += 1
        return count

    def write_scan(self, number: int, topic: str, index: int, cloud: Any) -> int:  # noqa: ANN401 - of the bag
        """Write a scan, by its index in its topic; return its bytes.

        Raises:
            ValueError: No point is left of it.
        """
        stamp_ns = self._stamp_ns(number, topic, index)
        sensors = self._sensors(number)
        scan, dropped = sensors.scans.scan(cloud, self._own_ns(topic, index), index)
        with self._lock:
            self._points_dropped.update(dropped)
        if not len(scan.points):
            reasons = ', '.join(reason for reason, count in dropped.items() if count)
            raise ValueError(f'no point is left of it: {reasons}' if reasons else 'it has no point')
        scan = self._grid.snapped(scan)
        self.writer.write_scan(number, stamp_ns, scan)
        self._depth_maps.write(number, stamp_ns, scan.points, sensors)
        return scan.points.nbytes

    def write_image(self, camera: int, number: int, topic: str, index: int, image: Any) -> int:  # noqa: ANN401 - of the bag
        """Write an image, by its index in its topic; return its bytes."""
        png = self._sensors(number).images.png(camera, image, self._png)
        self.writer.write_image(camera, number, self._stamp_ns(number, topic, index), png)
        return len(png)

    def write_labels(self, number: int, solid: list[Any], flat: list[Any]) -> int:
        """Write the labels of a frame; return 0: sizes are those of scans and images.

        Args:
            number: The number of the frame.
            solid: The messages with boxes.
            flat: The messages with boxes in the image.
        """
        frame = number - self.first
        times = times_of_boxes(self.plan, self.frames, frame)
        stamp_ns = int(self.frames.stamps_ns[frame])
        boxes = self._sensors(number).labels.boxes(merge_markers(solid), stamp_ns, times, flat)
        self.writer.write_labels(number, boxes)
        self.empty_labels += not boxes
        return 0

    def write_poses(self, track: Track) -> int:
        """Write the poses of the frames, each of which must have one; return how many."""
        stamps_ns = self.frames.stamps_ns
        poses = camera_poses(track, stamps_ns, self.rigs.first.body_t_rect())
        posed = [pose for pose in poses if pose is not None]
        for number, (stamp_ns, pose) in enumerate(zip(stamps_ns.tolist(), posed, strict=True)):
            self.writer.write_pose(number, stamp_ns, pose)
        return len(posed)

    def notes(self) -> list[str]:
        """Return notes on depth maps, tracks and dropped points."""
        notes = [*self._depth_maps.notes(), *self.writer.notes()]
        if self.plan.scan is not None:
            notes += dropped_notes(self.plan.scan.topic, self._points_dropped)
            notes += self._grid.notes(self.plan.scan.topic)
        return notes

    def _sensors(self, number: int) -> SensorRig:
        return self.rigs.of(number - self.first)

    def _stamp_ns(self, number: int, topic: str, index: int) -> int:
        """Return a sample's own stamp where the layout stores it, else the frame's."""
        if self.plan.layout.traits.stamps_per_stream:
            return self._own_ns(topic, index)
        return int(self.frames.stamps_ns[number - self.first])

    def _own_ns(self, topic: str, index: int) -> int:
        return int(self.frames.stamps[topic][index])


def times_of_boxes(plan: Plan, frames: Frames, frame: int) -> BoxTimes:
    """Return when the boxes of a frame and its scan are placed, by the position of the frame."""
    topics = frame_topics(plan)
    index = int(frames.samples[Stream.LABELS][frame])
    boxes = topics[Stream.LABELS]
    own_ns, moved_ns = (int(times[boxes][index]) for times in (frames.stamps, frames.moved_ns))
    cloud_ns = int(frames.stamps_ns[frame])
    scans = frames.samples.get(Stream.SCAN)
    if scans is not None and scans[frame] != NONE:
        cloud_ns = int(frames.stamps[topics[Stream.SCAN]][scans[frame]])
    return BoxTimes(own_ns - moved_ns, cloud_ns, moved_ns)


# Notes on a written object set with labels: its faults for programs that train on it.
#
# OpenPCDet concatenates the objects of each label file (pcdet/datasets/kitti/kitti_dataset.py,
# get_infos); create_data.py of mmdetection3d takes the first frame of each of train, val and test
# (tools/dataset_converters/update_infos_to_v2.py).

_LISTS = {'val': '--split 0.8 fills val.txt', 'test': 'a bag converted with --name testing has it'}
"""By list of ImageSets that may be empty, what fills it."""


def set_notes(plan: Plan, folder: Path, files: int, empty: int) -> Iterator[str]:
    """Yield notes on a set; none if it is no object set with labels.

    Args:
        plan: The plan of the set.
        folder: The one with ImageSets.
        files: Number of label files.
        empty: Number of those without a line.
    """
    if plan.labels is None or not plan.layout.traits.frame_set or not files:
        return
    if empty:
        yield (
            f'{empty} of {files} label files have no line, which stops OpenPCDet: take these frames'
            f' out of ImageSets/train.txt and val.txt'
        )
    paths = {name: folder / names.IMAGE_SETS / f'{name}{names.TXT}' for name in _LISTS}
    missing = [name for name, path in paths.items() if not STORE.read_text(path).strip()]
    if missing:
        lists = ' and '.join(f'{name}{names.TXT}' for name in missing)
        are = 'is empty' if len(missing) == 1 else 'are empty'
        yield (
            f"ImageSets/{lists} {are}, which stops mmdetection3d's create_data.py:"
            f' {"; ".join(_LISTS[name] for name in missing)}'
        )


# Samples of a plan's frames -> files, each when its message is read; and the report.


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


def run_job(job: SampleJob) -> tuple[SampleJob, int | Exception]:
    """Write a sample; return the bytes written, or why it was not."""
    try:
        return job, job.write()
    except (ValueError, KittiRos2Error) as error:
        return job, error


class SetBuilder:
    """Writes the samples of the frames of a data set, in the order in which they are read.

    Attributes:
        counts: Files, or lines of a common file, by stream.
        size_bytes: Size of the files with samples so far.
    """

    def __init__(
        self,
        samples: SampleWriter,
        packets: PacketMaker,
        target: Target,
        losses: LossTally,
        survey: Survey,
    ) -> None:
        """Take the parts of a conversion.

        Args:
            samples: Writes the samples.
            packets: Makes the packets of oxts.
            target: The data set.
            losses: Takes the messages that cannot be used.
            survey: The survey of the bags.
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
        needed = {
            topic: [index for stream in streams for index in self._numbers[stream]]
            for topic, streams in self._streams.items()
        }
        self._videos = BagVideos(survey, needed)
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
            messages: Each with its index in its topic.
            decode: By the types of their bags.
        """
        for index, message in messages:
            if message.topic in self._videos:
                yield from self._video_jobs(self._videos.take(index, message, decode))
                continue
            yield from self._message_jobs(index, message, decode)
        yield from self._video_jobs(self._videos.rest())
        # An excerpt has one message of each frame.
        for number, solid, flat in self._labels.rest():
            self._take_labels(number, solid, flat, 0)

    def _message_jobs(
        self, index: int, message: BagMessage, decode: Decoder
    ) -> Iterator[SampleJob]:
        """Yield the files of the samples that a message is needed for."""
        samples = [
            (stream, self._numbers[stream][index])
            for stream in self._streams.get(message.topic, ())
            if index in self._numbers[stream]
        ]
        labelled = self._labels.frames_of(message.topic, index)
        packet = self._packets.wants(message.topic, index)
        if not samples and not labelled and not packet:
            return
        try:
            decoded = decode(message)
        except ValueError as error:
            self._losses.lose(message.topic, message.stamp_ns, str(error))
            self._exclude([*(number for _, number in samples), *labelled])
            decoded = None
        if packet:
            self._packets.take(message.topic, index, decoded)
            self.write_packets()
        for number, solid, flat in self._labels.take(message.topic, index, decoded):
            self._take_labels(number, solid, flat, message.stamp_ns)
        if decoded is None:
            return
        for stream, number in samples:
            yield self._job(stream, number, index, message, decoded)

    def _video_jobs(self, images: Iterable[Outcome]) -> Iterator[SampleJob]:
        """Yield the files of images of videos; those that are in no frame are left out."""
        for index, message, image in images:
            for stream in self._streams[message.topic]:
                number = self._numbers[stream].get(index)
                if number is None:
                    continue
                if isinstance(image, ValueError):
                    self._losses.lose(message.topic, message.stamp_ns, str(image))
                    self._exclude([number])
                else:
                    yield self._job(stream, number, index, message, image)

    def write_packets(self) -> None:
        """Write the packets that are complete."""
        self.counts[Stream.OXTS.value] += self._packets.write(
            self._samples.writer, self._target.first
        )

    def _job(
        self,
        stream: Stream,
        number: int,
        index: int,
        message: BagMessage,
        decoded: Any,  # noqa: ANN401 - of the bag's types
    ) -> SampleJob:
        samples, topic = self._samples, message.topic
        if stream is Stream.SCAN:
            write = partial(samples.write_scan, number, topic, index, decoded)
        else:
            write = partial(samples.write_image, stream.camera or 0, number, topic, index, decoded)
        return SampleJob(stream, number, topic, message.stamp_ns, write)

    def _take_labels(self, number: int, solid: list[Any], flat: list[Any], log_ns: int) -> None:
        """Write labels in order and at once: tracks are numbered as they appear."""
        topic = frame_topics(self._samples.plan)[Stream.LABELS]
        write = partial(self._samples.write_labels, number, solid, flat)
        self.take(*run_job(SampleJob(Stream.LABELS, number, topic, log_ns, write)))

    def take(self, job: SampleJob, outcome: int | Exception) -> None:
        """Count a sample by its outcome: the bytes written, or an error."""
        if isinstance(outcome, Exception):
            at_ns = outcome.stamp_ns if isinstance(outcome, UnknownTransformError) else job.stamp_ns
            self._losses.lose(job.topic, at_ns, str(outcome))
            self._exclude([job.number])
            return
        self.counts[job.stream.value] += 1
        self.size_bytes += outcome

    def _exclude(self, numbers: Any) -> None:  # noqa: ANN401 - an iterable of numbers
        """Exclude frames with a missing sample from the lists of frames."""
        for number in numbers:
            self._samples.writer.leave_out(number)

    def write_poses(self, track: Track) -> None:
        """Write the poses of the frames, each of which must have one."""
        self.counts[Stream.POSE.value] = self._samples.write_poses(track)

    def report(self, survey: Survey, damaged: tuple[Loss, ...]) -> ImportReport:
        """Return the report of the conversion, after the writer is closed."""
        plan, frames, rigs = self._samples.plan, self._samples.frames, self._samples.rigs
        notes = [*survey.notes, *frames.notes, *rigs.notes(), *self._packets.notes()]
        notes += [*self._samples.notes(), *self._videos.notes()]
        if not self._target.first and self._target.excerpt is None:
            files = self.counts[Stream.LABELS.value]
            notes += set_notes(plan, self._target.stage, files, self._samples.empty_labels)
        lost = self._losses.losses()
        undecoded = undecoded_losses(survey, plan, {loss.stream for loss in lost})
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
                *oxts_losses(survey, plan, frames.stamps_ns),
                *self._packets.losses,
                *rigs.losses(),
            ),
            notes=tuple(notes),
        )


def _numbers(samples: Any, first: int) -> dict[int, int]:  # noqa: ANN401 - Int64Array
    """Map indices in a topic to frame numbers."""
    frames = np.flatnonzero(samples != NONE)
    return dict(zip(samples[frames].tolist(), (frames + first).tolist(), strict=True))


# Conversion of bags by a plan: one pass, each sample written when it is read.

_KITTI_IMAGES = re.compile(r'kitti', re.IGNORECASE)
"""In topics of KITTI's images in bags of to-bag, kitti2bag, kitti2mcap and others."""
_KITTI_360_IMAGES = re.compile(r'kitti/camera_[0-3]/', re.IGNORECASE)


def _png_form(plan: Plan) -> PngForm:
    """Return the form of KITTI's or KITTI-360's files if the topics of all images name them."""
    topics = [camera.topic for camera in plan.cameras.values()]
    forms = {PngForm.KITTI_360: _KITTI_360_IMAGES, PngForm.KITTI: _KITTI_IMAGES}
    named = (form for form, images in forms.items() if all(map(images.search, topics)))
    return next(named, PngForm.FAST) if topics else PngForm.FAST


_LABEL_DECIMALS = 4  # a tenth of a millimetre: boxes of programs are finer than hand-made ones


def build(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    target: Target,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> ImportReport:
    """Convert bags as apply_plan.convert_by_plan does, into the folder of a target.

    Raises:
        BadBagError, UsageError, MissingDataError: As there.
        OSError: A file cannot be written.
    """
    losses = LossTally()
    survey = clocked(survey, plan)
    motion = read_motion(bags, plan, survey, losses)
    frames = target.frames
    if frames is None:
        frames = choose_frames(plan, survey, motion.of_frames, options.selection)
    if frames.unsynchronised:
        raise UnsynchronisedError(f'no two streams have a frame in common: {frames.unsynchronised}')
    if target.excerpt is not None:
        frames = target.excerpt.of(frames)
    rigs = SensorRigs(plan, survey, frames, motion.tree)
    packets = PacketMaker(plan, survey, frames, rigs.first, motion)
    topic, why = plan.pose.topic if plan.pose else '', why_unposed(plan)
    for stamps_ns, missing in ((frames.unposed_ns, NO_FRAME), (packets.lost_ns, NO_PACKET)):
        for stamp_ns in stamps_ns.tolist():
            losses.lose(topic, stamp_ns, f'{missing}, for {why}')
    written = WriteOptions(_LABEL_DECIMALS, options.train_fraction)
    with make_writer(plan.layout, target.stage, plan.name, written) as writer:
        samples = SampleWriter(plan, frames, rigs, writer, target.first, options)
        builder = SetBuilder(samples, packets, target, losses, survey)
        builder.write_calibration()
        with open_messages(bags, builder.topics, must_read=False) as messages:
            read = with_indices(messages)
            if target.excerpt is not None:
                read = target.excerpt.read(messages, survey, frames, frame_topics(plan))
            outcomes = ordered_map(
                run_job,
                builder.jobs(read, Decoder(messages.typestore, lent=True)),
                worker_count(),
            )
            with closing(outcomes):
                for count, (job, outcome) in enumerate(outcomes, 1):
                    builder.take(job, outcome)
                    progress(count, builder.size_bytes)
            damaged = damage({**messages.losses, **survey.losses}, path_of(bags[0]).name)
        builder.write_packets()
        if motion.track is not None and Stream.POSE in writer.accepts:
            builder.write_poses(motion.track)
    return builder.report(survey, damaged)
