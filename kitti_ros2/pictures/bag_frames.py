# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a bag not written by to-bag, arranged by the importer's plan."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from ..bags.bag_files import OpenBag, path_of
from ..bags.open_source import open_source
from ..drawing.drawn_objects import colour_pixels, objects_of
from ..files.image_files import parse_png
from ..importer.bag_labels import joined
from ..importer.bag_poses import guess_pose, read_moving, read_track
from ..importer.bag_scans import without_unreadable_scans
from ..importer.box_labels import class_name, own_number
from ..importer.clocks import clocked
from ..importer.guess import guess_plan
from ..importer.kitti_frames import choose_frames, frame_topics
from ..importer.plan import NONE as NO_CALIBRATION
from ..importer.plan import Incomplete, topic_of
from ..importer.rigging import Rigging, Riggings
from ..importer.set_builder import times_of_boxes
from ..importer.survey import look
from ..kitti.label_file import labels_of_text
from ..messages.detections import ABSURD, UNPLACED
from ..messages.naming import LABEL_LINES, decode_text
from ..model.errors import (
    KittiRos2Error,
    LossTally,
    MissingDataError,
    UsageError,
    damage,
    describe_error,
    describe_frames,
)
from ..model.geometry import Transform
from ..model.samples import NONE, FrameLabels, Pose, Trajectory
from ..model.streams import CAMERA_NAMES, IMAGE_STREAMS, Layout, Stream
from ..own_bags.numbering import BY_POSITION, number_bag
from ..own_bags.recording import BagRecording, PlacedMessages, places_of
from .recording_frames import FrameData, RecordingFrames

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import BagSource
    from ..drawing.drawn_objects import Pixels
    from ..importer.kitti_frames import Frames
    from ..importer.plan import Plan, ScanPlan
    from ..importer.survey import Survey
    from ..messages.moving_tree import MovingTree, Track
    from ..model.boxes import Cuboid
    from ..model.errors import Loss
    from ..model.geometry import Float64Array
    from ..model.recording import FrameOrigin
    from ..model.samples import Calibration, Image, Int64Array, Sample, Scan
    from ..options.read import ReadOptions
    from ..own_bags.recorded_layout import Blueprint
    from ..own_bags.recording import Place
    from .recording_frames import FrameSource


# The poses of a bag not written by to-bag, as the odometry layout would be made from them.


class EgoTrack(NamedTuple):
    """Poses, and the frame that they are of."""

    track: Track
    body: str

    def trajectory(self, body_T_imu: Transform) -> Trajectory:
        """Return all poses, of the unit instead of the body."""
        stamps_ns = self.track.stamps_ns
        poses = [pose @ body_T_imu for pose in self.track.at(stamps_ns) if pose is not None]
        return Trajectory(stamps_ns, poses)


def ego_track(bag: BagSource, survey: Survey, notes: list[str]) -> EgoTrack | None:
    """Read the poses that the odometry layout would be made from, if any."""
    pose, losses = guess_pose(survey, []), LossTally()
    if pose is None:
        return None
    try:
        track = read_track([bag], pose, survey, losses)
    except KittiRos2Error as error:
        notes.append(str(error))
        return None
    notes.extend(f'{loss.stream}: {loss.text()}' for loss in losses.losses())
    return EgoTrack(track, pose.body)


T = TypeVar('T')

_OPTICAL = 'z'


class BagFrames:
    """The FrameSource of a bag; frames are numbered by position, from 0.

    Images whose camera_info contains a distortion are rectified, so that projections into them are
    right.

    Args:
        bag: The bag.
        survey: The survey of the bag.

    Raises:
        BadBagError: The bag cannot be read.
        MissingDataError: The bag has neither point clouds nor images.
    """

    def __init__(self, bag: BagSource, survey: Survey) -> None:
        path = path_of(bag)
        self.name = path.name
        guess = guess_plan(survey, Layout.OBJECT, path)
        plan = _to_look_at(without_unreadable_scans(guess.plan, survey))
        notes = list(guess.notes)
        assumptions: list[str] = []
        losses = LossTally()
        survey = clocked(survey, plan)
        moving = read_moving([bag], plan, survey, losses)
        notes.extend(f'{loss.stream}: {loss.text()}' for loss in losses.losses())
        self._plan, self._no_calibration = _rigged(plan, survey, moving, assumptions)
        if self._plan.calibration == NO_CALIBRATION:
            assumptions += _turned(self._plan.scan)
        assumptions.append(BY_POSITION)
        self.assumptions: Sequence[str] = assumptions
        labels = self._plan.labels
        self._own_lines = labels is not None and labels.topic == LABEL_LINES
        self._track = ego_track(bag, survey, notes)
        self.origins: Mapping[int, FrameOrigin] = {}
        self.base_t_imu = self._find_unit(survey)
        frames = choose_frames(self._plan, survey, None)
        self._frames = frames
        self._riggings = Riggings(self._plan, survey, frames, moving)
        self.stamps_ns = frames.stamps_ns
        self.numbers: Int64Array = np.arange(len(frames), dtype=np.int64)
        self.cameras: Mapping[int, str] = {
            index: CAMERA_NAMES.get(index, str(index)) for index in self._plan.cameras
        }
        self._places = {
            stream: _places(topic, survey, frames, stream)
            for stream, topic in frame_topics(self._plan).items()
        }
        self.streams: Mapping[str, Int64Array] = {
            stream.value: np.flatnonzero([place is not None for place in places])
            for stream, places in self._places.items()
        }
        self._label_places = _label_places(self._plan, survey, frames)
        self._messages = PlacedMessages(bag, set(frame_topics(self._plan).values()))
        self.losses: Sequence[Loss] = damage(survey.losses, path.name)
        self.notes: Sequence[str] = (*notes, *survey.notes, *frames.notes)

    def trajectory(self) -> Trajectory:
        """Return all poses of the bag, also those between its frames."""
        if self._track is None:
            return Trajectory(np.zeros(0, np.int64), [])
        return self._track.trajectory(self.base_t_imu)

    def close(self) -> None:
        """See FrameSource."""
        self._messages.close()

    def _find_unit(self, survey: Survey) -> Transform:
        """Return body_T_imu from static transforms; the identity if they do not contain it."""
        pose, unit = self._track, self._plan.imu_frame
        if pose is None or not unit:
            return Transform.identity()
        tree = survey.tree
        return tree.find(pose.body, unit) or Transform.identity()

    def frame(self, number: int, wanted: frozenset[str] | None = None) -> FrameData:
        """See FrameSource."""
        if not 0 <= number < len(self.numbers):
            raise UsageError(
                f'{self.name} has no frame {number}; it has {describe_frames(self.numbers)}'
            )
        stamp_ns = int(self.stamps_ns[number])
        missing = dict(self._no_calibration)
        made: dict[Stream, Any] = {}
        for stream in self._places:
            if wanted is not None and stream.value not in wanted:
                continue
            try:
                camera = stream.camera
                one = self.read(stream, number) if camera is None else self.pixels(camera, number)
            except KittiRos2Error as error:
                missing[stream.value] = str(error)
                continue
            if one is not None:
                made[stream] = one
        calibration = self.calibration(number)
        labels = made.get(Stream.LABELS, FrameLabels())
        scan = made.get(Stream.SCAN)
        missing |= {f'labels {row}': reason for row, reason in labels.missing.items()}
        return FrameData(
            source=self.name,
            number=number,
            stamp_ns=stamp_ns,
            images={stream.camera: made[stream] for stream in made if stream.camera is not None},
            points=None if scan is None else scan.points,
            calibration=calibration,
            objects=objects_of(labels, calibration),
            labelled=Stream.LABELS in made,
            pose=self._pose(stamp_ns),
            path=self._path(stamp_ns) if wanted and Stream.PATH.value in wanted else None,
            imaged=bool(self.cameras),
            scanned=Stream.SCAN in self._places,
            missing=missing,
        )

    def read(self, stream: Stream, number: int) -> Sample | None:
        """See FrameSource; packets of a GPS/IMU unit are made by a conversion only."""
        if stream is Stream.POSE:
            return self._pose(int(self.stamps_ns[number]))
        if stream.camera is not None:
            return self._converted(stream, number, partial(self._image, stream.camera, number))
        if stream is Stream.LABELS:
            return self._labels_of(number)
        return self._converted(stream, number, partial(self._scan, number))

    def scan_at(self, number: int, stamp_ns: int) -> Scan | None:  # noqa: ARG002
        """See FrameSource; the times of the points of other bags are not read."""
        raise MissingDataError(
            f'{self.name}: to-bag did not write it, so the time of the points is not known'
        )

    def pixels(self, camera: int, number: int) -> Pixels | None:
        """See FrameSource."""
        decode = partial(self._rigging(number).images.pixels, camera)
        pixels = self._converted(IMAGE_STREAMS[camera], number, decode)
        return None if pixels is None else colour_pixels(pixels)

    def calibration(self, number: int) -> Calibration | None:
        """See FrameSource."""
        return self._rigging(number).calibrations.at(int(self.stamps_ns[number]))

    def _rigging(self, number: int) -> Rigging:
        """Return the rigging of a frame; that of the first where its own is invalid."""
        try:
            return self._riggings.of(number)
        except ValueError:
            return self._riggings.first

    def _converted(self, stream: Stream, number: int, convert: Callable[[Any], T]) -> T | None:
        """Read and convert the message of a frame; None if the frame has none."""
        place = self._places[stream][number] if stream in self._places else None
        if place is None:
            return None
        with _described(place, number):
            return convert(self._messages.read(place))

    def _scan(self, number: int, message: Any) -> Scan:  # noqa: ANN401 - of the bag's types
        place = self._frames.samples[Stream.SCAN][number]
        stamps_ns = self._frames.stamps[frame_topics(self._plan)[Stream.SCAN]]
        scan, _ = self._rigging(number).scans.scan(message, int(stamps_ns[place]))
        return scan

    def _labels_of(self, number: int) -> FrameLabels | None:
        """Read the messages with the boxes of a frame; None if it has none."""
        places = self._label_places[number] if self._label_places else ()
        if not places:
            return None
        with _described(places[0], number):
            return self._labels([self._messages.read(place) for place in places], number)

    def _labels(self, messages: Sequence[Any], number: int) -> FrameLabels:
        if self._own_lines:
            return labels_of_text(decode_text(messages[0]))
        times = times_of_boxes(self._plan, self._frames, number)
        cuboids, left_out = self._rigging(number).labels.all_cuboids(joined(messages), times)
        topic = frame_topics(self._plan)[Stream.LABELS]
        lost = [
            f'{topic}: {left_out.count(reason)} boxes {reason} are left out'
            for reason in (ABSURD, UNPLACED)
            if reason in left_out
        ]
        missing = {'boxes': '; '.join(lost)} if lost else {}
        return FrameLabels(cuboids=[_identified(each) for each in cuboids], missing=missing)

    def _image(self, camera: int, number: int, message: Any) -> Image:  # noqa: ANN401 - as _scan
        return parse_png(self._rigging(number).images.png(camera, message), 'the message')

    def _path(self, stamp_ns: int) -> Float64Array | None:
        """Return (N, 3) positions up to a time, None without any."""
        stamps_ns, positions = self._all_positions
        found = positions[stamps_ns <= stamp_ns]
        return found if len(found) else None

    @cached_property
    def _all_positions(self) -> tuple[Int64Array, Float64Array]:
        """Stamps and (N, 3) positions of all poses."""
        track = self.trajectory()
        positions = [pose.translation for pose in track.world_T_imu]
        return track.stamps_ns, np.array(positions, np.float64).reshape(-1, 3)

    def _pose(self, stamp_ns: int) -> Pose | None:
        if self._track is None:
            return None
        (pose,) = self._track.track.at(np.array([stamp_ns], dtype=np.int64))
        return None if pose is None else Pose(pose @ self.base_t_imu)


def _to_look_at(plan: Plan) -> Plan:
    """Return the plan with incomplete frames, and with boxes outside the camera's view."""
    labels = None if plan.labels is None else replace(plan.labels, out_of_view=True)
    return replace(plan, incomplete=Incomplete.KEEP, labels=labels)


def _rigged(
    plan: Plan, survey: Survey, moving: MovingTree | None, assumptions: list[str]
) -> tuple[Plan, dict[str, str]]:
    """Return the plan, without calibration and labels if it is missing, and the reason."""
    try:
        Rigging(plan, survey, moving)
    except KittiRos2Error as error:
        assumptions.append(f'no calibration: {error}')
        missing = {Stream.CALIBRATION.value: str(error)}
        return replace(plan, calibration=NO_CALIBRATION, labels=None), missing
    return plan, {}


def _turned(scan: ScanPlan | None) -> list[str]:
    """Return the assumption that makes the points of a depth camera look ahead."""
    if scan is None or scan.forward != _OPTICAL:
        return []
    return [f'{scan.topic} is in {scan.frame}: its z axis is taken as forward']


def _identified(cuboid: Cuboid) -> Cuboid:
    """Return the box with its class in the form of labels, and its track if it is a number."""
    return replace(
        cuboid, class_name=class_name(cuboid.class_name), track_id=own_number(cuboid.identity)
    )


@contextmanager
def _described(place: Place, number: int) -> Iterator[None]:
    """Raise any error as that of the message of a frame: a recorder may have written any bytes."""
    try:
        yield
    except Exception as error:
        what = f'{place.topic}: the message of frame {number}: {describe_error(error)}'
        raise KittiRos2Error(what) from error


def _label_places(plan: Plan, survey: Survey, frames: Frames) -> list[list[Place]]:
    """Return the places of the messages with the boxes of each frame, none without labels."""
    if plan.labels is None:
        return []
    log_ns = np.array(topic_of(survey, plan.labels.topic).log_ns, dtype=np.int64)
    every = (place for group in frames.label_places for place in group)
    found = iter(places_of(plan.labels.topic, log_ns, every))
    return [[next(found) for _ in group] for group in frames.label_places]


def _places(topic: str, survey: Survey, frames: Frames, stream: Stream) -> list[Place | None]:
    """Return the place of the message of each frame, None for a frame without one."""
    log_ns = np.array(topic_of(survey, topic).log_ns, dtype=np.int64)
    samples = frames.samples[stream].tolist()
    found = iter(places_of(topic, log_ns, (place for place in samples if place != NONE)))
    return [None if place == NONE else next(found) for place in samples]


# Opens the source of pictures: a KITTI folder or a bag.


def open_frames(path: Path, options: ReadOptions) -> FrameSource:
    """Open the frames of a KITTI folder or a bag.

    Raises:
        UsageError: The path does not exist.
        KittiRos2Error: The source cannot be read, or contains nothing to draw.
    """
    source = open_source(path, options)
    if not isinstance(source, OpenBag):
        return RecordingFrames(source)
    with source as bag:  # the frames keep its files open until they are closed
        survey = look([bag])
        return open_bag_frames(bag, survey, open_own_recording(bag, survey))


def open_bag_frames(
    bag: OpenBag, survey: Survey, own: BagRecording | None
) -> RecordingFrames | BagFrames:
    """Open the frames of a bag: with KITTI's numbers if written by to-bag, else by position.

    Args:
        bag: The bag.
        survey: The survey of the bag.
        own: Its recording, if to-bag wrote it.

    Raises:
        BadBagError: The bag cannot be read.
        MissingDataError: The bag contains nothing to draw.
    """
    return BagFrames(bag, survey) if own is None else RecordingFrames(own, bag.path.name)


def open_own_recording(
    bag: OpenBag, survey: Survey, blueprint: Blueprint | None = None
) -> BagRecording | None:
    """Open the recording in a bag written by to-bag; None if frames have no KITTI numbers.

    Args:
        bag: The bag.
        survey: The survey of the bag.
        blueprint: The layout of the recording, if already read.

    Raises:
        BadBagError: The bag cannot be read.
    """
    log_ns = {
        name: np.array(each.log_ns, np.int64) for name, each in survey.topics.items() if each.count
    }
    numbered = number_bag(bag, log_ns, blueprint=blueprint)
    if numbered is None:
        return None
    recording = BagRecording(bag, numbered, survey)
    if recording.streams:
        return recording
    recording.close()
    return None
