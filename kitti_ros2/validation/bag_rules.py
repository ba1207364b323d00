# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about a whole bag, single messages, and topics."""

from __future__ import annotations

import time
from array import array
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.container_file import qos_faults
from ..bags.locate import METADATA
from ..messages.camera_info import camera_model
from ..messages.clouds import read_points
from ..messages.images import picture_kind, pixels_of
from ..messages.naming import FrameNames
from ..messages.rectified_cameras import angle_of
from ..messages.scan_sources import SCAN_TYPES
from ..messages.videos import codec_of, is_video
from ..model.bag_formats import (
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    FIX,
    IMAGE,
    IMU,
    MARKERS,
    ODOMETRY,
    PATH,
    POSE,
    STRING,
    TF_TYPES,
    TRACKED_OBJECTS,
    TWIST,
    VIDEOS,
)
from ..model.errors import format_count
from ..model.streams import NS_PER_S, format_stamp
from .rule import ERROR, NOTE, WARNING, Breach, RuleScope, RuleTable, breach_in

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..messages.tf_tree import FrameTree
    from ..model.samples import Int64Array


# Rules about a whole bag: container, metadata, schemas, frames, cameras and their images.

Size = tuple[int, int]
_MOST_UNPAIRED = 64
"""Stored sizes of a topic, compared with those of the other topic by stamp."""
_UNDEFINED = 'it is copied as it is'
_ABSENT = f'has no {METADATA}'
_SPELLED = 'otherwise than ROS 2 (capital letters)'
_GROUND_TRUTH = '/kitti/ground_truth/'
"""Topics of to-bag, whose frames may be a separate tree."""
_FIXED = frozenset({'', 'map', 'odom', 'world', 'earth'})


class CameraSizes:
    """Sizes of images and of the CameraInfo beside them, paired by their stamps.

    Both may change within a bag: the frames of an object set have several sizes.
    """

    def __init__(self) -> None:
        self._latest: dict[str, dict[int, Size]] = defaultdict(dict)
        self._all: dict[str, set[Size]] = defaultdict(set)
        self._infos: dict[str, set[str]] = defaultdict(set)
        self._images: dict[str, set[str]] = defaultdict(set)
        self._paired: dict[tuple[str, str], tuple[Size, Size] | None] = {}

    def add_info(self, topic: str, stamp_ns: int, size: Size) -> None:
        """Add the size of a CameraInfo."""
        namespace = topic.rpartition('/')[0]
        if namespace:
            self._infos[namespace].add(topic)
            self._enter(topic, stamp_ns, size)
            for image in self._images[namespace]:
                self._compare(topic, image, stamp_ns)

    def add_image(self, topic: str, stamp_ns: int, size: Size) -> None:
        """Add the size of an image."""
        namespace, image, _ = topic.rpartition('/image')
        if image and namespace:
            self._images[namespace].add(topic)
            self._enter(topic, stamp_ns, size)
            for info in self._infos[namespace]:
                self._compare(info, topic, stamp_ns)

    def _enter(self, topic: str, stamp_ns: int, size: Size) -> None:
        latest = self._latest[topic]
        latest[stamp_ns] = size
        if len(latest) > _MOST_UNPAIRED:
            del latest[next(iter(latest))]
        if len(self._all[topic]) < _MOST_UNPAIRED:
            self._all[topic].add(size)

    def _compare(self, info: str, image: str, stamp_ns: int) -> None:
        sizes = self._latest[info].get(stamp_ns), self._latest[image].get(stamp_ns)
        if sizes[0] is not None and sizes[1] is not None and not self._paired.get((info, image)):
            self._paired[info, image] = None if sizes[0] == sizes[1] else (sizes[0], sizes[1])

    def differences(self) -> Iterator[tuple[str, Size, str, Size]]:
        """Yield topics of CameraInfo and images with different sizes, and the first of these.

        Without equal stamps they differ if they have no common size.
        """
        for namespace, infos in sorted(self._infos.items()):
            for info, image in product(sorted(infos), sorted(self._images[namespace])):
                sizes = self._paired.get((info, image))
                apart = self._all[info].isdisjoint(self._all[image])
                if (info, image) not in self._paired and apart:
                    sizes = min(self._all[info]), min(self._all[image])
                if sizes is not None:
                    yield info, sizes[0], image, sizes[1]


@dataclass(eq=False)
class BagFacts:
    """The facts of a bag after one pass.

    Attributes:
        path: The bag.
        losses: Damage, one line each.
        notes: Lines that are no damage.
        left_out: Unreadable topics, each with the reason.
        messages: Number of messages.
        tree: The tree of its frames; None without transforms.
        changing: Static links published with two values.
        frames: Frames of the headers, each with a topic.
        sizes: Sizes of CameraInfo and images.
        per_frame: True for an object set of to-bag, with a calibration per frame.
    """

    path: Path
    losses: Sequence[str] = ()
    notes: Sequence[str] = ()
    left_out: Sequence[str] = ()
    messages: int = 0
    tree: FrameTree | None = None
    changing: Sequence[tuple[str, str]] = ()
    frames: dict[str, str] = field(default_factory=dict)
    sizes: CameraSizes = field(default_factory=CameraSizes)
    per_frame: bool = False

    def breach(self, text: str) -> Breach:
        """Return a breach in the bag, or in its file at the beginning of a text."""
        return breach_in(text, self.path)


BAG_RULES = RuleTable[BagFacts](RuleScope.BAG)


@BAG_RULES.add(
    'bag-damage',
    ERROR,
    'Files are whole, and the checksums of chunks and summaries are right',
    'kitti-ros2 recover copies the readable messages',
)
def _find_damage(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.losses:
        if METADATA not in text:
            yield bag.breach(text)


@BAG_RULES.add(
    'bag-metadata',
    ERROR,
    'metadata.yaml is readable, and agrees with the files',
    'ros2 bag reindex writes it again',
)
def _find_metadata(bag: BagFacts) -> Iterator[Breach]:
    for text in (*bag.losses, *bag.notes):
        if METADATA in text and not (_ABSENT in text and text in bag.notes):
            yield bag.breach(text)


@BAG_RULES.add(
    'bag-folder',
    WARNING,
    'A folder of bag files has a metadata.yaml',
    'nothing here needs it, but ros2 bag does for a folder: ros2 bag reindex writes it',
)
def _find_unindexed(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.notes:
        if _ABSENT in text:
            yield bag.breach(text.partition(';')[0])


@BAG_RULES.add(
    'bag-schema',
    WARNING,
    'Types are defined, and messages are CDR or of ROS 1',
    'the topics are left out; record them with their definitions',
)
def _find_unreadable(bag: BagFacts) -> Iterator[Breach]:
    undefined = (text.partition(';')[0] for text in bag.notes if _UNDEFINED in text)
    for text in (*bag.left_out, *undefined):
        yield bag.breach(text)


@BAG_RULES.add(
    'bag-field-names',
    WARNING,
    'Definitions have the field names of ROS 2',
    'they are read here, but other programs miss them; rosbags-convert leaves those of ROS 1',
)
def _find_spelled_fields(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.notes:
        if _SPELLED in text:
            yield bag.breach(text.partition(';')[0])


@BAG_RULES.add(
    'bag-empty',
    NOTE,
    'Bags contain messages',
    'check that the topics were published while recording',
)
def _find_empty(bag: BagFacts) -> Iterator[Breach]:
    if not bag.messages and not bag.losses:
        yield Breach('no messages', bag.path)


@BAG_RULES.add(
    'bag-note',
    NOTE,
    'Readers have no remarks',
    'nothing needs to be done: what is lost has a finding of its own',
)
def _find_notes(bag: BagFacts) -> Iterator[Breach]:
    for text in bag.notes:
        if not any(marker in text for marker in (METADATA, _UNDEFINED, _SPELLED)):
            yield bag.breach(text)


@BAG_RULES.add(
    'tf-tree',
    ERROR,
    'Every frame has one parent, and there are no circles',
    'stop one of the publishers, or rename its frame',
)
def _find_tree_faults(bag: BagFacts) -> Iterator[Breach]:
    for text in () if bag.tree is None else bag.tree.faults():
        yield Breach(text, bag.path)


@BAG_RULES.add(
    'tf-changing',
    WARNING,
    'Static transforms do not change',
    'subscribers use the last value: stop one of two publishers; to-kitti --layout object'
    ' writes the calibration of each frame',
)
def _find_changing(bag: BagFacts) -> Iterator[Breach]:
    for parent, child in () if bag.per_frame else bag.changing:
        yield Breach(f'{parent} -> {child} was published with two values', bag.path)


@BAG_RULES.add(
    'tf-apart',
    WARNING,
    'All frames are in one tree',
    'publish or record the transforms between the trees',
)
def _find_apart(bag: BagFacts) -> Iterator[Breach]:
    if bag.tree is None:
        return
    vehicle = bag.tree.root_of(FrameNames().base)
    truth = {frame for frame, topic in bag.frames.items() if topic.startswith(_GROUND_TRUTH)}
    roots = [root for root in bag.tree.roots if root == vehicle or root not in truth]
    if len(roots) > 1:
        yield Breach(f'{len(roots)} trees, of {", ".join(roots[:8])}', bag.path)


@BAG_RULES.add(
    'tf-frame',
    WARNING,
    'Frames of headers are in the tree',
    'correct frame_id of the driver, or publish the transform',
)
def _find_unknown_frames(bag: BagFacts) -> Iterator[Breach]:
    tree_frames = None if bag.tree is None else bag.tree.frames
    for frame, topic in sorted(bag.frames.items()):
        if tree_frames is not None and frame not in tree_frames and frame not in _FIXED:
            yield Breach(f'{topic}: frame {frame} is in no transform', bag.path)


@BAG_RULES.add(
    'camera-size',
    ERROR,
    'CameraInfo has the size of the images beside it',
    'load the calibration of this resolution in the driver',
)
def _find_other_size(bag: BagFacts) -> Iterator[Breach]:
    for info, size, image, shape in bag.sizes.differences():
        text = f'{info} is for {size[0]}x{size[1]}, {image} has {shape[0]}x{shape[1]}'
        yield Breach(text, bag.path)


# Rules about single messages of a bag: CameraInfo, PointCloud2, Image, transforms.

HEADED_TYPES = VIDEOS | {
    CLOUD, IMAGE, COMPRESSED, CAMERA_INFO, IMU, FIX, TWIST, ODOMETRY, POSE
}  # fmt: skip
"""Types of sensors and poses that begin with a header."""
_READ_TYPES = frozenset(
    {DETECTED_OBJECTS, DETECTIONS_2D, DETECTIONS_3D, MARKERS, PATH, TRACKED_OBJECTS}
)
CHECKED_TYPES = HEADED_TYPES | TF_TYPES | SCAN_TYPES | {STRING} | _READ_TYPES
"""Decoded types of messages: all that `to-kitti` and the evaluations read."""
_COEFFICIENTS = {
    'plumb_bob': {0, 4, 5},
    'rational_polynomial': {0, 8, 12, 14},
    'equidistant': {0, 4},
    'fisheye': {0, 4},
    'mei': {5},  # of KITTI-360's fisheyes, by to-bag
}
"""Numbers of D by distortion model (sensor_msgs/distortion_models.hpp, and OpenCV)."""
_PARALLEL_RAD = 1e-5
_NORM_OFF = 0.01  # tf2 refuses quaternions whose squared norm is off by 1 %


@dataclass(frozen=True, eq=False)
class CheckedMessage:
    """A message of a bag.

    Attributes:
        bag: The bag.
        topic, msgtype: Topic and type.
        stamp_ns: Log time.
        value: The decoded message; None if not decodable.
        error: The error of decoding.
        decode: True decodes the pixels of images.
    """

    bag: Path
    topic: str
    msgtype: str
    stamp_ns: int
    value: Any
    error: str = ''
    decode: bool = False

    def breach(self, text: str) -> Breach:
        """Return a breach of the message."""
        return Breach(f'{self.topic} at {self.stamp_ns}: {text}', self.bag)


MESSAGE_RULES = RuleTable[CheckedMessage](RuleScope.BAG)


@MESSAGE_RULES.add(
    'message-decode',
    ERROR,
    'Messages can be decoded by the definition of their type',
    'kitti-ros2 recover copies the readable messages',
)
def _find_undecodable(message: CheckedMessage) -> Iterator[Breach]:
    if message.error:
        yield message.breach(message.error)


@MESSAGE_RULES.add(
    'camera-uncalibrated',
    WARNING,
    'CameraInfo has K or P',
    'calibrate the camera; to-kitti --calib takes a calibration from elsewhere',
)
def _find_uncalibrated(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype == CAMERA_INFO and _is_uncalibrated(message.value):
        yield Breach(f'{message.topic}: K and P are zeros', message.bag)


def _is_uncalibrated(info: Any) -> bool:  # noqa: ANN401 - of the bag's types
    return info is not None and not (np.any(info.k) or np.any(info.p))


@MESSAGE_RULES.add(
    'camera-info',
    ERROR,
    'CameraInfo has a size, positive focal lengths, a rotation R, a region inside the image',
    'correct the calibration of the driver',
)
def _find_bad_camera(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None or _is_uncalibrated(message.value):
        return
    try:
        camera_model(message.value)
    except ValueError as error:
        yield Breach(f'{message.topic}: {error}', message.bag)


@MESSAGE_RULES.add(
    'camera-distortion',
    ERROR,
    'D has as many numbers as its distortion model',
    'set distortion_model to that of the calibration: plumb_bob has 5 numbers',
)
def _find_distortion(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None:
        return
    model, count = message.value.distortion_model, len(message.value.d)
    valid_counts = _COEFFICIENTS.get(model)
    if valid_counts is None and (model or count):
        text = f'the distortion model {model!r} is not one of {", ".join(_COEFFICIENTS)}'
        yield Breach(f'{message.topic}: {text}', message.bag)
    elif valid_counts is not None and count not in valid_counts:
        text = f'D has {count} numbers; {model} has {max(valid_counts)}'
        yield Breach(f'{message.topic}: {text}', message.bag)


@MESSAGE_RULES.add(
    'camera-rotation',
    WARNING,
    'R of CameraInfo is the identity where D is 0 and K is that of P',
    'programs that rectify turn such images once more: write R = I; to-kitti turns none',
)
def _find_idle_rotation(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype != CAMERA_INFO or message.value is None:
        return
    try:
        camera = camera_model(message.value)
    except ValueError:  # camera-info
        return
    if camera.is_as_rectified and angle_of(camera.r) > _PARALLEL_RAD:
        degrees = np.degrees(angle_of(camera.r))
        text = f'D is 0 and K is that of P, but R turns by {degrees:.2g} degrees'
        yield Breach(f'{message.topic}: {text}', message.bag)


@MESSAGE_RULES.add(
    'cloud-layout',
    ERROR,
    'PointCloud2 has x, y, z within point_step, and data for width x height points',
    'correct point_step, row_step and fields in the driver',
)
def _find_bad_cloud(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype == CLOUD and message.value is not None:
        try:
            read_points(message.value, None)
        except ValueError as error:
            yield message.breach(str(error))


@MESSAGE_RULES.add(
    'image-layout',
    ERROR,
    'Images have data for all rows; compressed ones are whole; video has a known codec',
    'correct step, width and height in the driver',
)
def _find_bad_image(message: CheckedMessage) -> Iterator[Breach]:
    image = message.value
    if message.msgtype == IMAGE and image is not None:
        if len(image.data) < image.step * image.height or not image.width * image.height:
            text = f'{len(image.data)} bytes of {image.width}x{image.height}, step {image.step}'
            yield message.breach(text)
    elif message.msgtype in VIDEOS | {COMPRESSED} and image is not None:
        try:
            (codec_of if is_video(image) else picture_kind)(image)
        except ValueError as error:
            yield message.breach(str(error))


@MESSAGE_RULES.add(
    'image-decode',
    ERROR,
    'Pixels of images can be decoded (with --decode)',
    'record the topic again',
)
def _find_bad_pixels(message: CheckedMessage) -> Iterator[Breach]:
    if not message.decode or message.value is None:
        return
    if message.msgtype in {IMAGE, COMPRESSED} and not is_video(message.value):
        try:
            pixels_of(message.value)
        except ValueError as error:
            yield message.breach(str(error))


@MESSAGE_RULES.add(
    'tf-transform',
    ERROR,
    'Transforms have finite numbers, quaternions of length 1, and names of both frames',
    'correct the publisher: tf2 refuses such transforms',
)
def _find_bad_transforms(message: CheckedMessage) -> Iterator[Breach]:
    if message.msgtype not in TF_TYPES or message.value is None:
        return
    for transform in message.value.transforms:
        q, t = transform.transform.rotation, transform.transform.translation
        link = f'{transform.header.frame_id} -> {transform.child_frame_id}'
        norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w  # ** raises where * is inf
        if not np.isfinite((t.x, t.y, t.z)).all() or not abs(norm - 1) < _NORM_OFF:
            numbers = f'{t.x:g} {t.y:g} {t.z:g}, {q.x:g} {q.y:g} {q.z:g} {q.w:g}'
            yield Breach(f'{message.topic}: {link} is {numbers}', message.bag)
        if not transform.header.frame_id or not transform.child_frame_id:
            yield Breach(f'{message.topic}: {link} has a frame without a name', message.bag)


# Rules about the stamps and the QoS of a topic in a bag.

_EARLIEST_NS = 946_684_800 * NS_PER_S
"""2000-01-01 UTC: the clock of a simulation begins at 0."""
_DAY_NS = 86_400 * NS_PER_S
_ONE_CLOCK_NS = 60 * NS_PER_S
_WIDE_GAP = 10.0
_LEAST_GAP_NS = NS_PER_S
_LEAST_MESSAGES = 10


@dataclass(eq=False)
class TopicTrack:
    """The stamps of a topic.

    Attributes:
        bag: The bag.
        topic: Name.
        latched: True if its publisher resends the last messages to late subscribers.
        profiles: QoS as rosbag2's text.
        log_ns: Log times, in the order of the bag.
        header_ns: Stamps of the headers, for types with one.
        unbegun: Packets of a video before the first key frame; None for other topics.
        undecoded: Log times of the packets without an image, by the reason.
    """

    bag: Path
    topic: str
    latched: bool = False
    profiles: str = ''
    log_ns: array[int] = field(default_factory=lambda: array('q'))
    header_ns: array[int] = field(default_factory=lambda: array('q'))
    unbegun: int | None = None
    undecoded: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))

    def breach(self, text: str) -> Breach:
        """Return a breach of the topic."""
        return Breach(f'{self.topic}: {text}', self.bag)

    def headers(self) -> Int64Array:
        """Return the header stamps that are not 0."""
        stamps: Int64Array = np.array(self.header_ns, np.int64)
        nonzero: Int64Array = stamps[stamps != 0]
        return nonzero


TOPIC_RULES = RuleTable[TopicTrack](RuleScope.STREAM)


@TOPIC_RULES.add(
    'header-order',
    WARNING,
    'Header stamps of a topic do not go back',
    'several publishers on the topic, or a clock that was set; to-kitti uses log times then',
)
def _find_backward(track: TopicTrack) -> Iterator[Breach]:
    stamps = track.headers()
    backward = np.flatnonzero(np.diff(stamps) < 0)
    if len(backward) and not track.latched:
        first = int(backward[0])
        count = format_count(len(backward), 'stamp')
        by = (int(stamps[first]) - int(stamps[first + 1])) / NS_PER_S
        yield track.breach(f'{count} before the one above, first by {by:.3g} s')


@TOPIC_RULES.add(
    'header-zero',
    WARNING,
    'Header stamps are not 0',
    'set header.stamp in the publisher; to-kitti uses log times then',
)
def _find_zero(track: TopicTrack) -> Iterator[Breach]:
    zeros = sum(stamp == 0 for stamp in track.header_ns)
    if zeros and not track.latched:
        yield track.breach(f'{zeros} of {len(track.header_ns)} header stamps are 0')


@TOPIC_RULES.add(
    'header-late',
    WARNING,
    'Header stamps are within 60 s of the log times',
    'recorded from another bag, or the clocks of the machines differ',
)
def _find_late(track: TopicTrack) -> Iterator[Breach]:
    if track.latched or len(track.header_ns) != len(track.log_ns):
        return
    header, log = np.array(track.header_ns, np.int64), np.array(track.log_ns, np.int64)
    dated = (header > _EARLIEST_NS) & (log > _EARLIEST_NS)
    delays = (log - header)[dated]
    far = np.abs(delays) > _ONE_CLOCK_NS
    if far.any():
        text = f'{int(far.sum())} of {len(header)} header stamps are'
        yield track.breach(f'{text} {delays[far][0] / NS_PER_S:.0f} s from their log times')


@TOPIC_RULES.add(
    'bag-future',
    WARNING,
    'Stamps are not in the future',
    'check the clock of the machine, and the unit: nanoseconds',
)
def _find_future(track: TopicTrack) -> Iterator[Breach]:
    latest = time.time_ns() + _DAY_NS
    for name, stamps in (('header stamp', track.header_ns), ('log time', track.log_ns)):
        last = max(stamps, default=0)
        if last > latest:
            yield track.breach(f'the last {name} is {_format_time(last)}')


@TOPIC_RULES.add(
    'bag-gap',
    WARNING,
    'Topics of a steady rate have no gap of 1 s and ten periods',
    'messages were dropped while recording: check the disk, or the QoS',
)
def _find_gap(track: TopicTrack) -> Iterator[Breach]:
    if len(track.log_ns) < _LEAST_MESSAGES or track.latched:
        return
    gaps = np.diff(np.sort(np.array(track.log_ns, np.int64)))
    usual, widest = float(np.median(gaps)), int(gaps.max())
    steady = float(np.percentile(gaps, 90)) < 2 * usual
    if steady and widest > max(_WIDE_GAP * usual, _LEAST_GAP_NS):
        text = f'a gap of {widest / NS_PER_S:.1f} s; usual are {usual / NS_PER_S:.3g} s'
        yield track.breach(text)


@TOPIC_RULES.add(
    'bag-latched',
    WARNING,
    '/tf_static is latched (QoS durability transient local)',
    'record with --qos-profile-overrides-path, else late subscribers get no frames',
)
def _find_unlatched(track: TopicTrack) -> Iterator[Breach]:
    if track.topic.endswith('tf_static') and track.profiles and not track.latched:
        yield track.breach('its publisher does not offer durability transient local')


@TOPIC_RULES.add(
    'bag-qos',
    WARNING,
    'Offered QoS profiles have known policies, and publishers of a topic agree',
    'ros2 bag play falls back to another QoS: give it --qos-profile-overrides-path',
)
def _find_qos_faults(track: TopicTrack) -> Iterator[Breach]:
    for fault in qos_faults(track.profiles):
        yield track.breach(fault)


@TOPIC_RULES.add(
    'video-start',
    WARNING,
    'A video begins with a key frame',
    'the bag was cut between key frames: those before the first cannot be decoded',
)
def _find_unbegun(track: TopicTrack) -> Iterator[Breach]:
    if track.unbegun:
        of = f'{track.unbegun} of {format_count(len(track.log_ns), "packet")}'
        yield track.breach(f'{of} {"is" if track.unbegun == 1 else "are"} before a key frame')


@TOPIC_RULES.add(
    'video-decode',
    ERROR,
    'Frames of a video can be decoded (with --decode)',
    'record the topic again',
)
def _find_undecoded(track: TopicTrack) -> Iterator[Breach]:
    for reason, stamps_ns in track.undecoded.items():
        count = format_count(len(stamps_ns), 'packet')
        yield track.breach(f'{count}, the first at {stamps_ns[0]}: {reason}')


def _format_time(stamp_ns: int) -> str:
    try:
        return f'{format_stamp(stamp_ns)} UTC'
    except (OverflowError, ValueError):
        return f'{stamp_ns} ns'
