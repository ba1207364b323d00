# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The recording in a bag not written by to-bag, as a plan arranges it; read message by message."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from ..bags.bag_files import path_of
from ..bags.single_messages import MessagesByPosition, positions_of
from ..drawing.labelled_objects import colour_pixels
from ..files.image_files import parse_png
from ..kitti.kitti_recording import no_calibration
from ..kitti.label_file import labels_of_text
from ..messages.detections import ABSURD, UNPLACED
from ..messages.naming import LABEL_LINES
from ..messages.source_texts import decode_text
from ..model.errors import KittiRos2Error, LossTally, damage, describe_error
from ..model.geometry import Transform
from ..model.recording import StreamIndex
from ..model.samples import NONE, FrameLabels, Pose, Trajectory
from ..model.streams import CAMERA_NAMES, IMAGE_STREAMS, Clock, Layout, Stream
from .bag_cameras import video_notes
from .bag_labels import merge_markers
from .bag_poses import guess_pose, read_moving, read_track
from .bag_scans import without_unreadable_scans
from .bag_videos import open_video
from .box_labels import class_name, own_number
from .clocks import clocked
from .guess import guess_plan
from .kitti_frames import choose_frames, frame_topics
from .plan import NONE as NO_CALIBRATION
from .plan import Incomplete
from .sensor_rig import SensorRig, SensorRigs
from .set_builder import times_of_boxes
from .survey import topic_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from ..bags.bag_files import BagSource
    from ..bags.single_messages import MessagePosition
    from ..drawing.labelled_objects import Pixels
    from ..messages.moving_tree import MovingTree, Track
    from ..model.boxes import Cuboid
    from ..model.errors import Loss
    from ..model.recording import FrameOrigin
    from ..model.samples import Calibration, Image, Sample, Scan
    from .kitti_frames import Frames
    from .plan import Plan, ScanPlan
    from .survey import Survey


# The poses of a bag not written by to-bag, as the odometry layout would be made from them.


class EgoTrack(NamedTuple):
    """Poses, and the frame that they are of."""

    track: Track
    body: str

    def trajectory(self, body_T_imu: Transform) -> Trajectory:
        """Return all poses, of the imu instead of the body."""
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


class PlannedRecording:
    """The recording in a bag; its frames are those of an object set, numbered by position from 0.

    Images whose camera_info contains a distortion are rectified, so that projections into them are
    right. Poses are no stream: they are interpolated between those of the bag, at stamps of frames.
    Packets of a GPS/IMU are made by a conversion only.

    Args:
        source: The bag.
        survey: The survey of the bag.

    Attributes:
        streams: Index by stream, of frames that have a sample, with the stamps of the frames.
        base_t_imu: imu_link in the body that the poses are of.
        no_calibration: Why there is none, by part; empty for a plan without.
        guess_notes: Guesses that may make pictures wrong, such as axes; one line each.

    Raises:
        BadBagError: The bag cannot be read.
        MissingDataError: The bag has neither point clouds nor images.
    """

    layout = None
    clock = Clock.UTC
    common_numbers = True
    start = None
    file_names = None

    def __init__(self, source: BagSource, survey: Survey) -> None:
        self.root = path_of(source)
        guess = guess_plan(survey, Layout.OBJECT, self.root)
        plan = _for_pictures(without_unreadable_scans(guess.plan, survey))
        notes = list(guess.notes)
        losses = LossTally()
        survey = clocked(survey, plan)
        moving = read_moving([source], plan, survey, losses)
        notes.extend(f'{loss.stream}: {loss.text()}' for loss in losses.losses())
        self.guess_notes: list[str] = []
        self._plan, self.no_calibration = _without_missing(plan, survey, moving, self.guess_notes)
        if self._plan.calibration == NO_CALIBRATION:
            self.guess_notes += _forward_notes(self._plan.scan)
        self._topics = frame_topics(self._plan)
        self._track = ego_track(source, survey, notes)
        self.origins: Mapping[int, FrameOrigin] = {}
        self.base_t_imu = self._find_imu(survey)
        self._frames = frames = choose_frames(self._plan, survey, None)
        self._rigs = SensorRigs(self._plan, survey, frames, moving)
        self.cameras: Mapping[int, str] = {
            index: CAMERA_NAMES.get(index, str(index)) for index in self._plan.cameras
        }
        self._positions = {
            stream: _positions(topic, survey, frames.samples[stream].tolist())
            for stream, topic in self._topics.items()
        }
        self.streams: Mapping[Stream, StreamIndex] = {
            stream: _index(frames, positions) for stream, positions in self._positions.items()
        }
        self._label_positions = _label_positions(self._plan, survey, frames)
        self._messages = MessagesByPosition(source, set(self._topics.values()))
        self._videos = {
            stream: open_video(survey.topics[topic], self._messages)
            for stream, topic in self._topics.items()
            if survey.topics[topic].keys is not None
        }
        self.losses: Sequence[Loss] = damage(survey.losses, self.root.name)
        videos = video_notes(self._plan, survey)
        self.notes: Sequence[str] = (*notes, *survey.notes, *frames.notes, *videos)

    def trajectory(self) -> Trajectory:
        """Return all poses of the bag, also those between its frames."""
        if self._track is None:
            return Trajectory(np.zeros(0, np.int64), [])
        return self._track.trajectory(self.base_t_imu)

    def close(self) -> None:
        """Close the files."""
        self._messages.close()

    def _find_imu(self, survey: Survey) -> Transform:
        """Return body_T_imu from static transforms; the identity if they do not contain it."""
        pose, imu_frame = self._track, self._plan.imu_frame
        if pose is None or not imu_frame:
            return Transform.identity()
        tree = survey.tree
        return tree.find(pose.body, imu_frame) or Transform.identity()

    def read(self, stream: Stream, number: int) -> Sample | None:
        """Read the sample of a frame; None if it has none.

        Raises:
            KittiRos2Error: Its message is missing or cannot be converted.
        """
        if stream is Stream.POSE:
            return self._pose(int(self._frames.stamps_ns[number]))
        if stream.camera is not None:
            return self._converted(stream, number, partial(self._image, stream.camera, number))
        if stream is Stream.LABELS:
            return self._labels_of(number)
        return self._converted(stream, number, partial(self._scan, number))

    def pixels(self, camera: int, number: int) -> Pixels | None:
        """Decode the image of a frame, (H, W, 3) uint8 BGR; None if it has none.

        Raises:
            KittiRos2Error: As read.
        """
        decode = partial(self._sensors(number).images.pixels, camera)
        pixels = self._converted(IMAGE_STREAMS[camera], number, decode)
        return None if pixels is None else colour_pixels(pixels)

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame, empty without any."""
        stamp_ns = int(self._frames.stamps_ns[number])
        return self._sensors(number).calibrations.at(stamp_ns) or no_calibration('')

    def _sensors(self, number: int) -> SensorRig:
        """Return the rig of a frame; that of the first where its own is invalid."""
        try:
            return self._rigs.of(number)
        except ValueError:
            return self._rigs.first

    def _converted(self, stream: Stream, number: int, convert: Callable[[Any], T]) -> T | None:
        """Read and convert the message of a frame; None if the frame has none."""
        position = self._positions[stream][number] if stream in self._positions else None
        if position is None:
            return None
        with _naming_errors(position, number):
            if stream in self._videos:
                return convert(
                    self._videos[stream].image(int(self._frames.samples[stream][number]))
                )
            return convert(self._messages.read(position))

    def _scan(self, number: int, message: Any) -> Scan:  # noqa: ANN401 - of the bag's types
        index = self._frames.samples[Stream.SCAN][number]
        stamps_ns = self._frames.stamps[self._topics[Stream.SCAN]]
        scan, _ = self._sensors(number).scans.scan(message, int(stamps_ns[index]))
        return scan

    def _labels_of(self, number: int) -> FrameLabels | None:
        """Read the messages with the boxes of a frame; None if it has none."""
        positions = self._label_positions[number] if self._label_positions else ()
        if not positions:
            return None
        with _naming_errors(positions[0], number):
            return self._labels([self._messages.read(position) for position in positions], number)

    def _labels(self, messages: Sequence[Any], number: int) -> FrameLabels:
        if self._topics[Stream.LABELS] == LABEL_LINES:
            return labels_of_text(decode_text(messages[0]))
        times = times_of_boxes(self._plan, self._frames, number)
        cuboids, left_out = self._sensors(number).labels.all_cuboids(merge_markers(messages), times)
        topic = self._topics[Stream.LABELS]
        lost = [
            f'{topic}: {left_out.count(reason)} boxes {reason} are left out'
            for reason in (ABSURD, UNPLACED)
            if reason in left_out
        ]
        missing = {'boxes': '; '.join(lost)} if lost else {}
        return FrameLabels(cuboids=[_with_track_id(cuboid) for cuboid in cuboids], missing=missing)

    def _image(self, camera: int, number: int, message: Any) -> Image:  # noqa: ANN401 - as _scan
        return parse_png(self._sensors(number).images.png(camera, message), 'the message')

    def _pose(self, stamp_ns: int) -> Pose | None:
        if self._track is None:
            return None
        (pose,) = self._track.track.at(np.array([stamp_ns], dtype=np.int64))
        return None if pose is None else Pose(pose @ self.base_t_imu)


def _for_pictures(plan: Plan) -> Plan:
    """Return the plan with incomplete frames, and with boxes outside the camera's view."""
    labels = None if plan.labels is None else replace(plan.labels, out_of_view=True)
    return replace(plan, incomplete=Incomplete.KEEP, labels=labels)


def _without_missing(
    plan: Plan, survey: Survey, moving: MovingTree | None, guess_notes: list[str]
) -> tuple[Plan, dict[str, str]]:
    """Return the plan, without calibration and labels if it is missing, and the reason."""
    try:
        SensorRig(plan, survey, moving)
    except KittiRos2Error as error:
        guess_notes.append(f'no calibration: {error}')
        missing = {Stream.CALIBRATION.value: str(error)}
        return replace(plan, calibration=NO_CALIBRATION, labels=None), missing
    return plan, {}


def _forward_notes(scan: ScanPlan | None) -> list[str]:
    """Return a note where the z axis of a depth camera is taken as forward."""
    if scan is None or scan.forward != _OPTICAL:
        return []
    return [f'{scan.topic} is in {scan.frame}: its z axis is taken as forward']


def _with_track_id(cuboid: Cuboid) -> Cuboid:
    """Return the box with its class in the form of labels, and its track if it is a number."""
    return replace(
        cuboid, class_name=class_name(cuboid.class_name), track_id=own_number(cuboid.identity)
    )


@contextmanager
def _naming_errors(position: MessagePosition, number: int) -> Iterator[None]:
    """Raise any error as that of the message of a frame: a recorder may have written any bytes."""
    try:
        yield
    except Exception as error:
        text = f'{position.topic}: the message of frame {number}: {describe_error(error)}'
        raise KittiRos2Error(text) from error


def _label_positions(plan: Plan, survey: Survey, frames: Frames) -> list[list[MessagePosition]]:
    """Return the positions of the messages with the boxes of each frame, none without labels."""
    if plan.labels is None:
        return []
    log_ns = np.array(topic_of(survey, plan.labels.topic).log_ns, dtype=np.int64)
    indices = (index for group in frames.label_indices for index in group)
    positions = iter(positions_of(plan.labels.topic, log_ns, indices))
    return [[next(positions) for _ in group] for group in frames.label_indices]


def _positions(topic: str, survey: Survey, samples: Sequence[int]) -> list[MessagePosition | None]:
    """Return the position of the message of each frame, None for a frame without one."""
    log_ns = np.array(topic_of(survey, topic).log_ns, dtype=np.int64)
    positions = iter(positions_of(topic, log_ns, (index for index in samples if index != NONE)))
    return [None if index == NONE else next(positions) for index in samples]


def _index(frames: Frames, positions: Sequence[MessagePosition | None]) -> StreamIndex:
    numbers = np.flatnonzero([position is not None for position in positions])
    return StreamIndex(numbers, frames.stamps_ns[numbers])
