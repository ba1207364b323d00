# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Results recorded in a bag -> label boxes by frame number of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bags.bag_files import opened, path_of
from ..bags.reader import Decoder, open_messages
from ..importer.bag_poses import LinkTracks
from ..importer.box_labels import ImageOf, TrackIds, make_boxes
from ..importer.tf_frames import is_fixed
from ..kitti.kitti_recording import image_size
from ..messages.camera_info import static_links
from ..messages.cdr import stamp_ns_of
from ..messages.detections import boxes_of_detections_2d, cuboids_in, frames_in
from ..messages.naming import FrameNames, base_t_imu, every_naming
from ..messages.tf_tree import FrameTree, LinkTally
from ..messages.topics import own_topics
from ..model.bag_formats import (
    CLOCK,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    MARKERS,
    TF_TYPES,
    TRACKED_OBJECTS,
)
from ..model.boxes import Box, clip_bounds
from ..model.errors import (
    BadBagError,
    KittiRos2Error,
    Loss,
    LossTally,
    MissingDataError,
    UsageError,
    damage,
    did_you_mean,
    format_count,
)
from ..model.geometry import Transform
from ..model.samples import Image
from ..model.streams import IMAGE_STREAMS, format_stamp, from_sec_nanosec
from ..options.messages import MessageOptions
from ..own_bags.recording import BagRecording
from .ground_truth import ROUNDED_NS, PlayedTime, frames_of
from .track_metrics import CLASSES, ClassMap

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from ..bags.bag_files import BagSource
    from ..bags.reader import BagMessages
    from ..messages.detections import ImageBox
    from ..messages.moving_tree import PoseTrack
    from ..messages.tf_tree import Link
    from ..model.boxes import Cuboid
    from ..model.samples import Calibration
    from ..own_bags.recording import NumberedRecording
    from .ground_truth import StampedFrames


# Messages with results -> boxes in the form of KITTI's result files.
#
# Locations are in the rectified camera 0, the 2D box is the projection clipped to the image,
# truncation and occlusion are -1. Boxes without 3D have size -1, location -1000 and angles -10, as
# in the readme.txt of the object devkit.

NOMINAL_SIZE = (1242, 375)
"""Width and height of most of KITTI's images, for a recording without images."""

_UNKNOWN = -1
_DEFAULT_SCORE = 1.0
_LEFT = {3: 2, 1: 0}
"""Images of a right camera name the optical frame of the left one."""


class ResultBoxes:
    """Converts the messages of a topic.

    Args:
        recording: Source of calibrations and image sizes.
        msgtype: Type of the messages.
        frames: Finds the frames of boxes.
        classes: Maps their classes.
        camera: KITTI index of the camera whose pixels the 2D boxes are.
    """

    def __init__(
        self,
        recording: NumberedRecording,
        msgtype: str,
        frames: ResultFrames,
        classes: ClassMap,
        camera: int,
    ) -> None:
        self._recording = recording
        self._msgtype = msgtype
        self._frames = frames
        self._classes = classes
        self._camera = camera
        self._tracks = TrackIds()
        self._counts: Counter[str] = Counter()
        self._unusable: Counter[str] = Counter()
        self._nominal = ''
        self._find_size = lru_cache(maxsize=32)(self._image_size)

    def convert(self, result: ResultMessage) -> list[Box]:
        """Return the boxes of a frame.

        Raises:
            MissingDataError: The calibration is missing, or no transform joins a frame of boxes.
            ValueError: The same, or the message is invalid.
        """
        boxes = self._in_image(result) if self._msgtype == DETECTIONS_2D else self._solid(result)
        return [replace(box, frame=result.number) for box in boxes]

    def losses(self, topic: str) -> tuple[Loss, ...]:
        """Return the unusable boxes so far."""
        return tuple(
            Loss(topic, count, f'{topic}: boxes {reason}')
            for reason, count in self._unusable.items()
        )

    def notes(self, topic: str) -> tuple[str, ...]:
        """Return the notes on the boxes so far."""
        notes = [f'{topic}: {count} boxes {reason}' for reason, count in self._counts.items()]
        if self._nominal:
            width, height = NOMINAL_SIZE
            notes.append(f'{self._nominal}; 2D boxes are clipped to {width}x{height}')
        if self._frames.completed:
            names = ', '.join(sorted(self._frames.completed))
            notes.append(
                f"{topic}: the bag's transforms do not join {names} to velo_link; those that the"
                f' player publishes by default are used'
            )
        return tuple(notes)

    def _solid(self, result: ResultMessage) -> list[Box]:
        calibration = self._checked(self._recording.calibration(result.number))
        boxes, unseen = make_boxes(
            self._classified(self._cuboids(result, calibration)),
            calibration,
            ImageOf(self._camera, self._size(result.number)),
            self._tracks,
            occluded=_UNKNOWN,
        )
        if unseen:
            self._counts[f'out of view of camera {self._camera} are not scored'] += unseen
        return [replace(box, truncated=float(_UNKNOWN)) for box in boxes]

    def _checked(self, calibration: Calibration) -> Calibration:
        """Return the calibration.

        Raises:
            MissingDataError: A part that boxes need is missing.
        """
        needed = calibration.r0_rect, calibration.cam0_T_velo, calibration.cameras.get(self._camera)
        if any(part is None for part in needed):
            lacking = f'no calibration of camera {self._camera} and the scanner'
            raise MissingDataError(next(iter(calibration.missing.values()), lacking))
        return calibration

    def _cuboids(self, result: ResultMessage, calibration: Calibration) -> list[Cuboid]:
        """Decode the boxes of a message to velo_link."""
        names = frames_in(result.message)
        stamps_ns = result.stamp_ns, result.scan_ns
        to_velo = {name: self._frames.velo_t(name, calibration, *stamps_ns) for name in names}
        cuboids, left_out = cuboids_in(result.message, to_velo, scores=True)
        self._unusable.update(left_out)
        return cuboids

    def _classified(self, cuboids: Sequence[Cuboid]) -> list[Cuboid]:
        """Map boxes to KITTI's classes; unmapped ones are left out."""
        classified = []
        for cuboid in cuboids:
            namespace = cuboid.identity.rpartition('/')[0] if self._msgtype == MARKERS else ''
            class_name = self._classes.find(cuboid.class_name, namespace)
            if class_name:
                score = self._score(cuboid.score)
                classified.append(replace(cuboid, class_name=class_name, score=score))
        return classified

    def _score(self, score: float | None) -> float:
        if score is None:
            self._counts[f'have no score; {_DEFAULT_SCORE:g} is used'] += 1
        return _DEFAULT_SCORE if score is None else score

    def _in_image(self, result: ResultMessage) -> list[Box]:
        detections, left_out = boxes_of_detections_2d(result.message)
        self._unusable.update(left_out)
        bounds = np.array([detection.box_2d for detection in detections]).reshape(-1, 4)
        cut, _ = clip_bounds(bounds, self._size(result.number))
        boxes = []
        for detection, four in zip(detections, cut, strict=True):
            class_name = self._classes.find(detection.class_name)
            if not class_name or not self._is_of_camera(detection):
                continue
            if not np.isfinite(four).all():
                self._counts['out of the image are not scored'] += 1
                continue
            left, top, right, bottom = map(float, four)
            boxes.append(
                Box(
                    class_name=class_name,
                    truncated=float(_UNKNOWN),
                    occluded=_UNKNOWN,
                    alpha=-10.0,
                    box_2d=(left, top, right, bottom),
                    size_hwl=(-1.0, -1.0, -1.0),
                    location=(-1000.0, -1000.0, -1000.0),
                    rotation_y=-10.0,
                    score=self._score(detection.score),
                    track_id=self._tracks.number(detection.identity),
                )
            )
        return boxes

    def _is_of_camera(self, box: ImageBox) -> bool:
        """Return whether a 2D box may be in pixels of the camera, not of another one."""
        camera = self._frames.camera_of(box.frame)
        if camera in {None, self._camera, _LEFT.get(self._camera)}:
            return True
        self._unusable[f'in pixels of {box.frame}; those of camera {self._camera} are scored'] += 1
        return False

    def _size(self, number: int) -> tuple[int, int]:
        varies = self._recording.layout.traits.calibration_per_frame
        return self._find_size(number if varies else 0)

    def _image_size(self, number: int) -> tuple[int, int]:
        try:
            if isinstance(self._recording, BagRecording):
                return _size_in_bag(self._recording, self._camera, number)
            return image_size(self._recording, self._camera, number)
        except KittiRos2Error as error:
            self._nominal = self._nominal or str(error)
            return NOMINAL_SIZE


def _size_in_bag(recording: BagRecording, camera: int, number: int) -> tuple[int, int]:
    """Return (width, height) of the images of a camera; see kitti.kitti_recording.

    Raises:
        KittiRos2Error: The size is unknown.
    """
    varies = recording.layout.traits.calibration_per_frame
    seen_by = recording.calibration(number).cameras.get(camera)
    if not varies and seen_by is not None and seen_by.size is not None:
        return seen_by.size
    index = recording.streams.get(IMAGE_STREAMS[camera])
    numbers = [] if index is None else index.numbers.tolist()
    image_number = number if varies else next(iter(numbers), number)
    image = recording.read(IMAGE_STREAMS[camera], image_number) if image_number in numbers else None
    if isinstance(image, Image):
        return image.width, image.height
    raise MissingDataError(f'{recording.root}: no image of camera {camera} with a known size')


# Coordinate frames of results: velo_T_frame at a frame of the recording.
#
# The recording's own sensors have the poses of its calibration. The bag's transforms, static ones
# and moving ones at the stamp of the result, connect other frames to these. Parts of the player's
# tree that are missing in the bag are made from the calibration.

_VELO = FrameNames().velo


class ResultFrames:
    """Finds velo_T_frame of the frames of results.

    Args:
        bag: The bag of the results.
        topics: Type by topic of the bag.
        cameras: Names of the recording's cameras, by index.
        limit_ns: Largest extrapolation beyond the transforms of a moving link.
        losses: Collects transforms that cannot be decoded.

    Attributes:
        completed: Frames that required the recording's own tree.
        damage: Number of lost transform messages by topic; None if unknown.
    """

    def __init__(
        self,
        bag: BagSource,
        topics: Mapping[str, str],
        cameras: Mapping[int, str],
        limit_ns: int,
        losses: LossTally,
    ) -> None:
        self._bag = bag
        self._topics = {name for name, msgtype in topics.items() if msgtype in TF_TYPES}
        self._names = [names.frames_of(cameras) for names in every_naming()]
        self._limit_ns = limit_ns
        self._losses = losses
        self._own: tuple[Calibration, list[Link], Mapping[str, Transform]] | None = None
        self.completed: set[str] = set()
        self.damage: Mapping[str, int | None] = {}

    def camera_of(self, frame: str) -> int | None:
        """Return the camera whose optical frame has a name, None if no camera's has."""
        return next(
            (
                index
                for names in self._names
                for index in names.cameras
                if names.camera(index) == frame
            ),
            None,
        )

    def velo_t(
        self, frame: str, calibration: Calibration, stamp_ns: int, scan_ns: int
    ) -> Transform:
        """Return velo_T_frame.

        Args:
            frame: Name without a leading slash.
            calibration: The recording's calibration at the frame.
            stamp_ns: Stamp of the result, for frames that move with the vehicle.
            scan_ns: Stamp of the scan, for frames fixed in the world.

        Raises:
            MissingDataError: Nothing joins the frame to the scanner.
        """
        if frame == _VELO:
            return Transform.identity()
        links, sensors = self._own_tree(calibration)
        if frame in sensors:
            return sensors[frame]
        static, tracks = self._transforms
        at_ns = scan_ns if is_fixed(frame) or _is_still(frame, static, tracks) else stamp_ns
        poses = {link: _pose_at(track, at_ns, self._limit_ns) for link, track in tracks.items()}
        moved = [(*link, pose) for link, pose in poses.items() if pose is not None]
        lost = [link for link, pose in poses.items() if pose is None]
        of_bag = FrameTree([*static, *moved], lost)
        for name, velo_t_sensor in sensors.items():
            sensor_t_frame = of_bag.find(name, frame)
            if sensor_t_frame is not None:
                return velo_t_sensor @ sensor_t_frame
        placed = {link[1] for link in (*static, *moved, *lost)}
        added = [link for link in links if link[1] not in placed]
        velo_t_frame = FrameTree([*static, *moved, *added], lost).find(_VELO, frame)
        if velo_t_frame is None:
            raise MissingDataError(
                f'no transform at its stamp joins frame {frame!r} to {_VELO}; the bag has {of_bag}'
            )
        self.completed.add(frame)
        return velo_t_frame

    def _own_tree(self, calibration: Calibration) -> tuple[list[Link], Mapping[str, Transform]]:
        """Return the links that the player publishes, and velo_T_sensor by frame."""
        if self._own is None or self._own[0] is not calibration:
            base_t_unit = base_t_imu(MessageOptions())
            links = [static_links(calibration, base_t_unit, names) for names in self._names]
            tree = FrameTree(link for several in links for link in several)
            cameras = (names.camera(index) for names in self._names for index in names.cameras)
            transforms = {name: tree.find(_VELO, name) for name in (_VELO, *cameras)}
            sensors = {
                name: transform for name, transform in transforms.items() if transform is not None
            }
            self._own = calibration, links[0], sensors
        return self._own[1:]

    @cached_property
    def _transforms(self) -> tuple[list[Link], Mapping[tuple[str, str], PoseTrack]]:
        """The static links of the bag, and the poses over time of the others."""
        if not self._topics:
            return [], {}
        with open_messages(self._bag, self._topics) as messages:
            transforms = self._read_transforms(messages)
            self.damage = messages.losses
            return transforms

    def _read_transforms(
        self, messages: BagMessages
    ) -> tuple[list[Link], Mapping[tuple[str, str], PoseTrack]]:
        tally, links = LinkTally(), LinkTracks()
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
                continue
            still = 'static' in message.topic
            tally.add(decoded, still=still)
            if still:
                continue
            try:
                links.add(message.data, message.stamp_ns)
            except ValueError as error:
                self._losses.lose(message.topic, message.stamp_ns, str(error))
        static, moving, _ = tally.sorted()
        tracks = links.tracks()
        return static, {link: tracks[link] for link in moving if link in tracks}


def _is_still(frame: str, static: Sequence[Link], moving: Collection[tuple[str, str]]) -> bool:
    """Return whether no link above a frame moves."""
    above = {child: parent for parent, child, _ in static}
    moved = {child for _, child in moving}
    line = [frame]
    while line[-1] in above and above[line[-1]] not in line:
        line.append(above[line[-1]])
    return not moved.intersection(line)


def _pose_at(track: PoseTrack, stamp_ns: int, limit_ns: int) -> Transform | None:
    """Return the pose at a stamp, clamped to the first and last within the limit."""
    nearest = np.clip([stamp_ns], track.stamps_ns[0], track.stamps_ns[-1])
    if abs(int(nearest[0]) - stamp_ns) > limit_ns:
        return None
    return track.at(nearest)[0]


# The messages of a result topic, each assigned to a frame.
#
# A message belongs to the frame with the stamp nearest to that in its header. Without such a stamp
# (MarkerArrays may have none, some nodes use the time of the computer) it belongs to the last frame
# before its arrival, in the time of the player's /clock.

_TYPES = frozenset({DETECTIONS_3D, DETECTIONS_2D, DETECTED_OBJECTS, TRACKED_OBJECTS, MARKERS})
_EXPECTED = (
    'a topic of Detection3DArray, Detection2DArray, DetectedObjects, TrackedObjects or MarkerArray'
)


class ResultMessage(NamedTuple):
    """A message with the results of a frame.

    Attributes:
        number: Frame number.
        distance_ns: From the stamp of the frame, nanoseconds.
        stamp_ns: Header stamp, else that of the frame.
        scan_ns: At which boxes in frames that do not move are placed: the stamp of the frame, or
            its own if that is one of the sensors' or an end of the turn.
        log_ns: Log time.
        message: Decoded.
    """

    number: int
    distance_ns: int
    stamp_ns: int
    scan_ns: int
    log_ns: int
    message: Any


class ResultMessages(NamedTuple):
    """The messages of a topic.

    Attributes:
        by_frame: By number of the frame, ascending.
        losses: Messages that cannot be decoded, belong to no frame or to one that has another
            message, and frames without one.
        damage: Number of lost messages by topic; None if unknown.
        notes: One line each.
        unanswered: The frames without a message, ascending.
    """

    by_frame: Mapping[int, ResultMessage]
    losses: tuple[Loss, ...]
    damage: Mapping[str, int | None]
    notes: tuple[str, ...]
    unanswered: tuple[int, ...]


class _Received(NamedTuple):
    """A decoded message with its log time and the stamp in its header, None without one."""

    log_ns: int
    header_ns: int | None
    message: Any


def choose_topic(bag: BagSource, types: Mapping[str, str], topic: str | None) -> str:
    """Return the topic of the results.

    Args:
        bag: For errors.
        types: Type by topic of the bag.
        topic: Requested topic; None for the only one with boxes besides the recording's own.

    Raises:
        UsageError: There is none, or several.
    """
    path = path_of(bag)
    possible = [name for name, msgtype in types.items() if msgtype in _TYPES]
    if topic is None:
        foreign = [name for name in possible if name not in own_topics()]
        if not foreign:
            others = ' besides the labels of the recording' if possible else ''
            raise UsageError(f'{path}: has no results{others}; expected {_EXPECTED}')
        if len(foreign) > 1:
            raise UsageError(
                f'{path}: has several topics with boxes, {", ".join(foreign)}; choose one with'
                f' --topic'
            )
        return foreign[0]
    if topic not in types:
        shown = did_you_mean(topic, types) or f'; with boxes: {", ".join(possible) or "none"}'
        raise UsageError(f'{path}: has no topic {topic}{shown}')
    if types[topic] not in _TYPES:
        raise UsageError(f'{path}: {topic} is a {types[topic]}; expected {_EXPECTED}')
    return topic


def read_messages(
    bag: BagSource, types: Mapping[str, str], topic: str, frames: StampedFrames
) -> ResultMessages:
    """Read the messages of a topic and assign them to frames.

    Of several for one frame the one with the nearest stamp is used, of equally near ones the last.

    Args:
        bag: The bag.
        types: Type by topic of the bag.
        topic: With results.
        frames: Frames of the recording.

    Raises:
        BadBagError: No message belongs to a frame.
    """
    tally = LossTally()
    received: list[_Received] = []
    with open_messages(bag, {topic}) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message)
            except ValueError as error:
                tally.lose(topic, message.stamp_ns, str(error))
                continue
            received.append(_Received(message.stamp_ns, _header_ns(decoded), decoded))
        damage = messages.losses
    placed, notes = _place(bag, types, topic, received, frames)
    by_frame: dict[int, ResultMessage] = {}
    for result in placed:
        other = by_frame.get(result.number)
        if other is None or result.distance_ns <= other.distance_ns:
            by_frame[result.number] = result
    unanswered = tuple(number for number in frames.numbers if number not in by_frame)
    unused = (
        _strays(topic, received, placed, frames),
        _repeated(topic, placed),
        Loss(topic, len(unanswered), f'{topic}: no message for frames {{}}', unanswered),
    )
    losses = (*tally.losses(), *(loss for loss in unused if loss.count))
    return ResultMessages(dict(sorted(by_frame.items())), losses, damage, notes, unanswered)


def _header_ns(message: Any) -> int | None:  # noqa: ANN401 - of the bag's types
    """Return the first stamp after 1970 of a message and its boxes, None without one.

    Of markers those that are added come first.
    """
    inner = [*getattr(message, 'detections', ()), *getattr(message, 'markers', ())]
    added = sorted(inner, key=lambda part: getattr(part, 'action', 0) != 0)
    headers = [part.header for part in (message, *added) if hasattr(part, 'header')]
    return next((stamp for header in headers if (stamp := stamp_ns_of(header)) > 0), None)


def _place(
    bag: BagSource,
    types: Mapping[str, str],
    topic: str,
    received: Sequence[_Received],
    frames: StampedFrames,
) -> tuple[list[ResultMessage], tuple[str, ...]]:
    """Return the messages that belong to a frame, and notes.

    Raises:
        BadBagError: None does.
    """
    stamped = [message for message in received if message.header_ns is not None]
    placed = [
        _placed(*match, message.header_ns, message, frames)
        for message in stamped
        if message.header_ns is not None and (match := frames.nearest(message.header_ns))
    ]
    others = [message for message in received if message.header_ns is None] if placed else received
    if others:
        time = _played_time(bag, types)
        arrived = [
            _placed(*match, frames.stamp_of(match[0]), other, frames)
            for other in others
            if (match := frames.latest(time.at(other.log_ns)))
        ]
        if not placed and not arrived:
            raise _no_frame(bag, topic, received, frames)
        note = (
            f'{topic}: {format_count(len(others), "message")} without a stamp of the recording;'
            f' each is taken for the last frame before its arrival'
        )
        return placed + arrived, (note,)
    if not placed:
        raise BadBagError(path_of(bag), f'has no readable message on {topic}', 'results')
    return placed, ()


def _placed(
    number: int, distance_ns: int, stamp_ns: int, received: _Received, frames: StampedFrames
) -> ResultMessage:
    """Return a message of a frame.

    A detector that gives the stamp of its scan has brought its boxes into the world by the pose at
    that stamp, whatever it is of the turn.
    """
    scan_ns = stamp_ns if distance_ns <= ROUNDED_NS else frames.reference_stamp_of(number)
    return ResultMessage(number, distance_ns, stamp_ns, scan_ns, received.log_ns, received.message)


def _no_frame(
    bag: BagSource, topic: str, received: Sequence[_Received], frames: StampedFrames
) -> BadBagError:
    stamp_ns = received[0].header_ns or received[0].log_ns
    fault = (
        f'none of the {format_count(len(received), "message")} of {topic} belongs to a frame: they'
        f' begin at {format_stamp(stamp_ns)}, the frames at {format_stamp(frames.first_ns)}'
    )
    expected = 'the stamps that the frames were played with (--epoch and --period change them)'
    return BadBagError(path_of(bag), fault, expected)


def _played_time(bag: BagSource, types: Mapping[str, str]) -> PlayedTime:
    """Read the time of the player; messages of /clock that cannot be decoded are skipped."""
    topics = {name for name, msgtype in types.items() if msgtype == CLOCK}
    log_ns, clock_ns = [], []
    if topics:
        with open_messages(bag, topics) as messages:
            decode = Decoder(messages.typestore)
            for message in messages:
                try:
                    clock = decode(message).clock
                except ValueError:
                    continue
                log_ns.append(message.stamp_ns)
                clock_ns.append(from_sec_nanosec(clock.sec, clock.nanosec))
    return PlayedTime(log_ns, clock_ns)


def _strays(
    topic: str,
    received: Sequence[_Received],
    placed: Sequence[ResultMessage],
    frames: StampedFrames,
) -> Loss:
    """Return the messages that belong to no frame as a loss; its count may be 0."""
    used = {id(result.message) for result in placed}
    strays = [message for message in received if id(message.message) not in used]
    first = format_stamp(strays[0].header_ns or strays[0].log_ns) if strays else ''
    text = (
        f'{topic}: no frame within {frames.tolerance_ns / 1e6:.1f} ms of the stamp of messages, the'
        f' first at {first}'
    )
    return Loss(topic, len(strays), text)


def _repeated(topic: str, placed: Sequence[ResultMessage]) -> Loss:
    """Return the further messages of frames as a loss; its count may be 0."""
    counts = Counter(result.number for result in placed)
    several = tuple(sorted(number for number, count in counts.items() if count > 1))
    text = f'{topic}: several messages for frames {{}}; the nearest in time is used, or the last'
    return Loss(topic, len(placed) - len(counts), text, several)


@dataclass(frozen=True)
class BagResults:
    """The results in a bag.

    Attributes:
        topic: Their topic.
        boxes: By number of each frame with a usable message, ascending.
        unanswered: The frames without a message, ascending; they are also a loss.
        losses: Unusable messages and boxes.
        notes: One line each.
    """

    topic: str
    boxes: Mapping[int, Sequence[Box]]
    unanswered: tuple[int, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def read_bag_results(
    bag: BagSource,
    topic: str | None,
    recording: NumberedRecording,
    class_map: Mapping[str, str],
    *,
    classes: Iterable[str] = CLASSES,
    tolerance_ns: int | None = None,
    camera: int = 2,
) -> BagResults:
    """Read the results on a topic of a bag.

    Args:
        bag: The bag.
        topic: A topic of Detection3DArray, Detection2DArray or MarkerArray; None for the only one
            besides those of the recording itself.
        recording: The ground truth, with the stamps and the calibration of the frames.
        class_map: KITTI's class of classes of the results, see ClassMap.
        classes: KITTI's own classes, matched in any case.
        tolerance_ns: The largest distance between the stamps of a message and of its frame; None is
            half the time between frames.
        camera: KITTI index of the camera whose pixels the 2D boxes are.

    Raises:
        BadBagError: The bag cannot be read, or no message belongs to a frame.
        UsageError: There is no such topic, it has no boxes, or several topics have.
    """
    frames, tally = frames_of(recording, tolerance_ns), LossTally()
    kitti_classes = ClassMap(class_map, classes)
    boxes: dict[int, Sequence[Box]] = {}
    with opened(bag) as source:
        with open_messages(source) as messages:
            types = dict(messages.channels)
        name = choose_topic(source, types, topic)
        results = read_messages(source, types, name, frames)
        tree = ResultFrames(source, types, recording.cameras, frames.tolerance_ns, tally)
        converter = ResultBoxes(recording, types[name], tree, kitti_classes, camera)
        for number, result in results.by_frame.items():
            try:
                boxes[number] = converter.convert(result)
            except (ValueError, KittiRos2Error) as error:
                tally.lose(name, result.log_ns, str(error))
        damaged = damage({**results.damage, **tree.damage}, source.path.name)
    losses = (*tally.losses(), *kitti_classes.losses(name), *converter.losses(name))
    return BagResults(
        name,
        boxes,
        results.unanswered,
        (*damaged, *results.losses, *losses),
        (*results.notes, *converter.notes(name)),
    )
