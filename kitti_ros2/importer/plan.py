# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion from a bag, as a user reads and edits it: topics and streams.

The table of roles lists the uses of topics. It is parsed and formatted as YAML, and checked.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from math import isfinite
from typing import TYPE_CHECKING, Any, get_type_hints

from ..messages.scan_sources import MODELS, SCAN_SOURCES, SCAN_TYPES
from ..model import bag_formats as types
from ..model.boxes import UNKNOWN_OCCLUSION, VISIBLE
from ..model.classes import KITTI_CLASSES, own_class
from ..model.errors import UsageError, did_you_mean, one_line, shown
from ..model.streams import GeoOrigin, Layout, Stream

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


# The plan of a conversion from a bag, as a user reads and edits it: topics and streams.

X_FORWARD = 'x'
"""The value of forward of a camera whose frame has x forward, y left, z up."""

TF = 'tf'
NONE = 'none'
SOURCE = 'source'
QUIET = 'quiet'
"""Metadata of the fields that a printed plan leaves out at their default."""


def _quiet(value: Any) -> Any:  # noqa: ANN401 - of the field
    return field(default=value, metadata={QUIET: True})


class Incomplete(str, Enum):
    """The treatment of a frame in which a stream has no sample."""

    DROP = 'drop'
    KEEP = 'keep'


class StampSource(str, Enum):
    """The stamps of all streams: of the messages' headers, or their log times."""

    HEADER = 'header'
    LOG = 'log'


class VelocityAxes(str, Enum):
    """The axes of a velocity: those of its frame, or east, north, up."""

    FRAME = 'frame'
    ENU = 'enu'


@dataclass(frozen=True)
class ScanPlan:
    """The source of the scans.

    Attributes:
        topic: A PointCloud2, CustomMsg (Livox), VelodyneScan, LaserScan or depth image.
        frame: The frame that becomes KITTI's velodyne frame (x forward, y left, z up); points are
            brought there by the static transforms where the messages are in another.
        intensity_scale: Divisor that scales intensities to 0..1.
        from_: The source of the scans: cloud, livox, velodyne, laser_scan or depth; empty for
            that of the topic's type.
        info: The CameraInfo of depth images, empty for none.
        model: The scanner of Velodyne packets: VLP-16, VLP-16-Hi-Res, VLP-32C, HDL-32E or HDL-64E;
            empty for the one that the packets name.
        calibration: The YAML file with the calibration of the scanner, as the ROS driver
            reads it; required for a HDL-64E, empty for the angles of the model's manual.
        minimum_range_m: Returns nearer to the scanner are dropped, metres.
        unit_m: The unit of x y z in clouds, metres: 0.001 for millimetres.
        offset_s: Added to the stamps, seconds, where a clock is wrong.
        forward: Forward of the scans, where x of the frame is not: a frame of the static tree whose
            orientation they get (base_link), or the axis of the frame that looks forward: -x, y,
            -y (up is z) or z (up is -y, an optical frame); or camera, the direction that camera 2
            looks in on the ground (with camera_sets the camera of each set): programs that train on
            KITTI take it for x. The origin stays that of the frame. Empty: the frame as it is.
    """

    topic: str
    frame: str
    intensity_scale: float = 1.0
    from_: str = _quiet('')
    info: str = _quiet('')
    model: str = _quiet('')
    calibration: str = _quiet('')
    minimum_range_m: float = _quiet(0.0)
    unit_m: float = _quiet(1.0)
    offset_s: float = _quiet(0.0)
    forward: str = _quiet('')


@dataclass(frozen=True)
class CameraPlan:
    """The source of a camera's images.

    Attributes:
        topic: An Image, a CompressedImage or a video.
        info: Its CameraInfo, empty for none.
        rectify: Whether the images are rectified.
        frame: The optical frame, empty for the CameraInfo's own.
        forward: x where the frame is no optical one but has x forward and z up, as those of many
            simulators: the optical frame is made in it.
        offset_s: As of the scan.
    """

    topic: str
    info: str = ''
    rectify: bool = False
    frame: str = ''
    forward: str = _quiet('')
    offset_s: float = _quiet(0.0)


@dataclass(frozen=True)
class PosePlan:
    """The source of the vehicle's poses.

    Attributes:
        topic: An Odometry, PoseStamped, Path or TFMessage.
        body: The frame whose poses they are: of Odometry its child frame, or one that transforms
            join to it.
        world: The frame they are given in: that of the messages, or one that transforms join to it,
            such as map above odom.
        offset_s: As of the scan.
        interpolate: Whether frames between two poses get one; otherwise each pose belongs to the
            frame at its stamp, as those of KITTI and KITTI-360, and frames without one have none.
    """

    topic: str
    body: str
    world: str = ''
    offset_s: float = _quiet(0.0)
    interpolate: bool = _quiet(value=True)


@dataclass(frozen=True)
class LabelPlan:
    """The source of the labels.

    Attributes:
        topic: A Detection3DArray, TrackedObjects or DetectedObjects (Autoware), a MarkerArray
            whose cubes are the boxes, a Detection2DArray for labels without 3D boxes, or the label
            lines that a bag written by to-bag contains.
        camera: The KITTI camera whose pixels the 2D boxes are.
        out_of_view: Whether boxes outside of the camera's view are kept.
        occluded: The occlusion written for boxes, whose messages have none: 0 visible, 1 partly, 2
            largely, 3 unknown. Evaluations leave 3 out (cpp/evaluate_object.cpp of the devkit).
            Label lines and tracklets in a bag written by to-bag have their own.
        boxes_2d: A Detection2DArray whose boxes are the 2D boxes of the labels, in pixels of the
            camera's images as they are in the bag; empty: the projections of the 3D boxes.
        classes: KITTI's class of each class of the topic, by name (in any case) or number. Those
            that are not listed have a default: see Classes of labels of the how-to.
        keep_classes: Whether classes without one of KITTI's keep their names, such as forklift;
            otherwise they become Misc.
        offset_s: As of the scan.
    """

    topic: str
    camera: int = 2
    out_of_view: bool = False
    occluded: int = VISIBLE
    boxes_2d: str = _quiet('')
    classes: Mapping[str, str] = field(default_factory=dict, metadata={QUIET: True})
    keep_classes: bool = _quiet(value=False)
    offset_s: float = _quiet(0.0)


@dataclass(frozen=True)
class Plan:
    """The rules by which bags are converted to a KITTI recording.

    Attributes:
        layout: Which of the four.
        name: Drive (2011_09_26_drive_0001_sync), split or sequence.
        reference: The stream whose samples are the frames: scan, image_N or pose.
        tolerance_s: Maximum distance of a sample from the stamp of its frame, seconds.
        incomplete: Whether frames without a message of a stream are dropped or kept; of a frame
            whose message cannot be decoded, the other files stay.
        scan: The source of the scans.
        cameras: The sources of images, by KITTI camera number.
        pose: The source of the poses.
        labels: The source of the labels.
        imu: Topic of an Imu for the packets of the GPS/IMU, empty for none.
        fix: Topic of a NavSatFix for the same, empty for none.
        velocity: Topic of a TwistStamped or an Odometry for the same, empty for none.
        velocity_axes: Those of its frame (frame), or east, north, up (enu): a receiver with one
            antenna does not know where it looks.
        imu_frame: The frame that becomes KITTI's imu frame (x forward, y left, z up).
        calibration: tf (CameraInfo and static transforms), source (the files in a bag written by
            to-bag), none, or a KITTI calibration file or folder.
        stamps: The stamps of all streams: header, or log (the times of recording) where the clocks
            of the sensors cannot be used.
        imu_offset_s: As offset_s of the scan, for imu.
        fix_offset_s: The same for fix.
        velocity_offset_s: The same for velocity.
        camera_sets: The sources of images of one data set a camera, by the sets' names, with the
            keys of a camera: it is camera 2 of its set, and scans and labels are in common
            (--all-cameras). Excludes cameras.
        origin: LAT,LON,ALT, degrees and metres, of the origin of poses that become oxts; empty for
            0,0,0.
    """

    layout: Layout
    name: str
    reference: str
    tolerance_s: float
    incomplete: Incomplete = Incomplete.DROP
    scan: ScanPlan | None = None
    cameras: Mapping[int, CameraPlan] = field(default_factory=dict)
    pose: PosePlan | None = None
    labels: LabelPlan | None = None
    imu: str = ''
    fix: str = ''
    velocity: str = ''
    velocity_axes: VelocityAxes = field(default=VelocityAxes.FRAME, metadata={QUIET: True})
    imu_frame: str = ''
    calibration: str = TF
    stamps: StampSource = field(default=StampSource.HEADER, metadata={QUIET: True})
    imu_offset_s: float = _quiet(0.0)
    fix_offset_s: float = _quiet(0.0)
    velocity_offset_s: float = _quiet(0.0)
    camera_sets: Mapping[str, CameraPlan] = field(default_factory=dict, metadata={QUIET: True})
    origin: str = ''

    @property
    def is_extract(self) -> bool:
        """Return whether the images stay unrectified."""
        return self.layout.traits.is_extract(self.name)

    @property
    def interpolates(self) -> bool:
        """Return whether frames between two poses get one."""
        return self.pose is None or self.pose.interpolate


# The roles that topics of a bag play in a data set, a row each.


@dataclass(frozen=True)
class Role:
    """The use of a topic for a data set.

    Attributes:
        key: In the plan: of the part that names the topic, or in that part.
        stream: KITTI's stream that is made of it; of a camera that of its number.
        msgtypes: The types that a plan is guessed from, the preferred ones first.
        more_types: Others that a plan may name.
        hint: How to use a topic of these types that a plan does not use.
    """

    key: str
    stream: Stream
    msgtypes: tuple[str, ...] = ()
    more_types: tuple[str, ...] = ()
    hint: str = ''

    @property
    def every_type(self) -> tuple[str, ...]:
        """The types that a plan may name."""
        return (*self.msgtypes, *self.more_types)


_OXTS_HINT = 'for oxts of the layouts raw and tracking: name the topic in imu, fix or velocity'

SCAN = Role(
    'scan',
    Stream.SCAN,
    (types.CLOUD,),
    tuple(sorted(SCAN_TYPES - {types.CLOUD})),
    'scans: name the topic in scan.topic',
)
IMAGES = Role(
    'cameras',
    Stream.IMAGE_2,
    (types.IMAGE, types.COMPRESSED, *sorted(types.VIDEOS)),
    hint='images: name the topic in cameras',
)
INFO = Role(
    'info',
    Stream.CALIBRATION,
    (types.CAMERA_INFO,),
    hint='calibration of images that are not used',
)
POSES = Role(
    'pose',
    Stream.POSE,
    (types.ODOMETRY, types.POSE, types.PATH),
    hint='poses: for the layouts odometry, raw and tracking: name the topic in pose.topic',
)
LABELS = Role(
    'labels',
    Stream.LABELS,
    (types.DETECTIONS_3D, types.TRACKED_OBJECTS, types.DETECTED_OBJECTS, types.MARKERS),
    (types.DETECTIONS_2D,),
    '3D boxes: for labels of the layouts object, raw and tracking: name the topic in labels.topic',
)
BOXES_2D = Role('boxes_2d', Stream.LABELS, more_types=(types.DETECTIONS_2D,))
IMU = Role('imu', Stream.OXTS, (types.IMU,), hint=_OXTS_HINT)
FIX = Role('fix', Stream.OXTS, (types.FIX,), hint=_OXTS_HINT)
VELOCITY = Role('velocity', Stream.OXTS, (types.TWIST,), (types.ODOMETRY,), _OXTS_HINT)

OXTS_ROLES = (IMU, FIX, VELOCITY)
"""Roles of the GPS/IMU, which have no part in the plan: the key is the topic's."""
ROLES = (SCAN, IMAGES, INFO, POSES, LABELS, BOXES_2D, *OXTS_ROLES)
"""The table; transforms have no row, for a plan uses all of them."""


# The topics that a plan names, each with its role.


@dataclass(frozen=True)
class TopicUse:
    """A topic that a plan names, and its use.

    Attributes:
        name: Its stream in texts: scan, image_2 (of a camera set: image_2 of NAME), pose, imu.
        key: In the plan: scan.topic, cameras.2.info, imu.
        topic: Its name.
        role: Its row of the table.
        stream: KITTI's stream that is made of it.
        offset_s: Added to its stamps, seconds.
    """

    name: str
    key: str
    topic: str
    role: Role
    stream: Stream
    offset_s: float

    def __str__(self) -> str:
        return f'{self.name} ({self.topic})'

    @property
    def offset_key(self) -> str:
        """The key of the offset."""
        part, _, _ = self.key.rpartition('.')
        return f'{part}.offset_s' if part else f'{self.key}_offset_s'


def topic_uses(plan: Plan) -> Iterator[TopicUse]:
    """Yield the topics that a plan names."""
    parts: list[tuple[str, str, Role, Stream, Any]] = [
        (role.key, role.key, role, role.stream, getattr(plan, role.key))
        for role in (SCAN, POSES, LABELS)
    ]
    for index, camera in plan.cameras.items():
        stream = Stream(f'image_{index}')
        parts.append((stream.value, f'cameras.{index}', IMAGES, stream, camera))
    for own, camera in plan.camera_sets.items():
        name = f'{Stream.IMAGE_2.value} of {own}'  # it is camera 2 of its set
        parts.append((name, f'camera_sets.{own}', IMAGES, Stream.IMAGE_2, camera))
    for name, key, role, stream, part in parts:
        if part is not None:
            yield TopicUse(name, f'{key}.topic', part.topic, role, stream, part.offset_s)
        for more in (INFO, BOXES_2D):
            topic = getattr(part, more.key, '')
            if topic:
                key_of = f'{key}.{more.key}'
                yield TopicUse(name, key_of, topic, more, more.stream, part.offset_s)
    for role in OXTS_ROLES:
        topic, offset_s = getattr(plan, role.key), getattr(plan, f'{role.key}_offset_s')
        if topic:
            yield TopicUse(role.key, role.key, topic, role, role.stream, offset_s)


# Check of the classes that a plan maps.


def check_classes(classes: object, where: str, *, any_word: bool) -> dict[str, str]:
    """Return the classes of a plan by name or number, with KITTI's spelling.

    Args:
        classes: The value in the file.
        where: The file and the key.
        any_word: Whether other classes than KITTI's are valid.

    Raises:
        UsageError: One is invalid; the error names the key.
    """
    if not isinstance(classes, dict):
        raise UsageError(f'{where}: {shown(classes)}; expected NAME: CLASS, ...')
    checked = {}
    for name, class_text in classes.items():
        if type(name) not in (str, int) or not isinstance(class_text, str):
            raise UsageError(
                f'{where}: {shown(name)}: {shown(class_text)}; expected two texts (quote numbers)'
            )
        kind = own_class(class_text)
        is_word = class_text.isprintable() and len(class_text.split()) == 1
        if kind is None and not (any_word and is_word):
            raise UsageError(
                f'{where}: {name}: {class_text!r}; expected {", ".join(KITTI_CLASSES)}, or any word'
                f' with keep_classes: true{did_you_mean(class_text, KITTI_CLASSES)}'
            )
        checked[str(name)] = kind or class_text
    return checked


# Check of the numbers of a plan.

_LONGEST_S = 4e9
"""127 years: header stamps, 32-bit seconds, plus that are still int64 nanoseconds."""


def as_number(value: float, where: str) -> float:
    """Return a number of a file as float.

    Raises:
        UsageError: It is not finite.
    """
    try:
        number = float(value)
    except OverflowError:  # of a whole number
        number = float('inf')
    if not isfinite(number):
        raise UsageError(f'{where}: {number}; expected a finite number')
    return number


def check_numbers(numbers: Mapping[str, Any], where: str) -> None:
    """Check the values of a plan, or of a part of it, against their limits.

    Args:
        numbers: By the names of the fields.
        where: The file and the part, for errors.

    Raises:
        UsageError: One is outside of its limits; the error names the key.
    """
    for key, value in numbers.items():
        if not isinstance(value, float):
            continue
        if key.endswith('offset_s') and abs(value) > _LONGEST_S:
            expected = f'seconds from -{_LONGEST_S:.0f} to {_LONGEST_S:.0f}'
        elif key == 'tolerance_s' and not 0 <= value <= _LONGEST_S:
            expected = f'seconds from 0 to {_LONGEST_S:.0f}'
        elif key == 'minimum_range_m' and value < 0:
            expected = '0 or more'
        elif key in {'intensity_scale', 'unit_m'} and value <= 0:
            expected = 'more than 0'
        else:
            continue
        raise UsageError(f'{where}{key}: {value}; expected {expected}')


# A plan as YAML: formatted, and parsed with the key of each error.

_SET_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_-]{0,99}')


def format_plan(plan: Plan, notes: tuple[str, ...] = ()) -> str:
    """Format the plan as YAML, with notes as comments above; the inverse of parse_plan."""
    import yaml  # noqa: PLC0415 - 15 ms that a report of a folder does not need

    values = _values(plan)
    values['cameras'] = dict(sorted(values['cameras'].items()))
    given_values = {name: value for name, value in values.items() if value not in (None, '', {})}
    comments = ''.join(f'# {one_line(note)}\n' for note in notes)
    return comments + yaml.safe_dump(given_values, sort_keys=False, width=100)


def _values(part: Any) -> Any:  # noqa: ANN401 - a plan, or a part of it
    """Return a part of a plan as YAML has it, without quiet fields at their default."""
    if isinstance(part, Enum):
        return part.value
    if isinstance(part, dict):
        return {name: _values(value) for name, value in part.items()}
    if not is_dataclass(part):
        return part
    values = {plan_field: getattr(part, plan_field.name) for plan_field in fields(part)}
    return {
        _key(plan_field.name): _values(value)
        for plan_field, value in values.items()
        if not (QUIET in plan_field.metadata and value in (plan_field.default, {}))
    }


def _key(name: str) -> str:
    """Return the key of a field: from of from_, which is a word of Python."""
    return name.rstrip('_')


def parse_plan(text: str, path: Path) -> Plan:
    """Parse a plan from YAML.

    Raises:
        UsageError: It is not a valid plan; the error names the key.
    """
    from ..model.yaml_text import YamlTextError, load_yaml  # noqa: PLC0415 - as above

    try:
        values = load_yaml(text)
    except YamlTextError as error:
        raise UsageError(f'{path}: is not valid YAML ({error})') from None
    if not isinstance(values, dict):
        raise UsageError(f'{path}: is not a plan; expected the output of to-kitti --plan')
    parts = dict(values)
    parts['cameras'] = cameras = _parse_cameras(parts.pop('cameras', None) or {}, path)
    parts['camera_sets'] = _parse_sets(parts.pop('camera_sets', None) or {}, path)
    if parts['camera_sets'] and cameras:
        raise UsageError(f'{path}: camera_sets: each has its own camera; expected no cameras')
    for name, kind in (('scan', ScanPlan), ('pose', PosePlan), ('labels', LabelPlan)):
        if parts.get(name) is not None:
            parts[name] = _make(kind, parts[name], path, name)
    _check_parts(parts, path)
    for name, choice in _CHOICES.items():
        if name in parts:
            parts[name] = _choose(choice, parts[name], f'{path}: {name}')
    plan: Plan = _make(Plan, parts, path, '')
    _check_origin(plan.origin, path)
    return plan


def _check_origin(text: str, path: Path) -> None:
    try:
        GeoOrigin.parse(text)
    except ValueError as error:
        raise UsageError(f'{path}: origin: {error}') from None


def _parse_cameras(cameras: object, path: Path) -> dict[int, CameraPlan]:
    if not isinstance(cameras, dict) or not all(
        type(key) is int and key in range(5) for key in cameras
    ):
        raise UsageError(
            f'{path}: cameras: expected KITTI camera numbers 0 to 4, found {shown(cameras)}'
        )
    return {key: _camera(value, path, f'cameras: {key}') for key, value in cameras.items()}


def _camera(value: object, path: Path, where: str) -> CameraPlan:
    camera: CameraPlan = _make(CameraPlan, value, path, where)
    if camera.forward not in {'', X_FORWARD}:
        raise UsageError(
            f'{path}: {where}: forward: {camera.forward}; expected {X_FORWARD}, or nothing for an'
            f' optical frame'
        )
    return camera


def _parse_sets(sets: object, path: Path) -> dict[str, CameraPlan]:
    where = f'{path}: camera_sets'
    if not isinstance(sets, dict):
        raise UsageError(f'{where}: {shown(sets)}; expected names of sets, each with a camera')
    for name in sets:
        if not isinstance(name, str) or not _SET_NAME.fullmatch(name):
            raise UsageError(
                f'{where}: {name!r}; expected a name of letters, digits, - and _, such as CAM_BACK'
            )
    if len({name.lower() for name in sets}) < len(sets):
        raise UsageError(f'{where}: names of sets must differ by more than case')
    return {name: _camera(value, path, f'camera_sets: {name}') for name, value in sets.items()}


def _check_parts(parts: dict[str, Any], path: Path) -> None:
    """Check the values of scan and labels; classes get KITTI's spelling."""
    scan, labels = parts.get('scan'), parts.get('labels')
    _check_words(scan, path)
    if labels is None:
        return
    if labels.occluded not in range(UNKNOWN_OCCLUSION + 1):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    where = f'{path}: labels: classes'
    classes = check_classes(labels.classes, where, any_word=labels.keep_classes)
    parts['labels'] = replace(labels, classes=classes)


def _check_words(scan: ScanPlan | None, path: Path) -> None:
    words = {'from': [source.word for source in SCAN_SOURCES], 'model': list(MODELS)}
    for key, valid in words.items():
        value = '' if scan is None else getattr(scan, 'from_' if key == 'from' else key)
        if value and value not in valid:
            hint = did_you_mean(value, valid)
            expected = ', '.join(valid)
            raise UsageError(
                f'{path}: scan: {key}: {shown(value)}; expected one of {expected}{hint}'
            )


def _choose(kind: type[Enum], value: object, where: str) -> Enum:
    try:
        # The error of an Enum has the whole value.
        return kind(value if isinstance(value, str) else None)
    except ValueError:
        names = [str(choice.value) for choice in kind]
        hint = did_you_mean(value if isinstance(value, str) else '', names)
        raise UsageError(f'{where}: {shown(value)}; expected {" or ".join(names)}{hint}') from None


def _make(kind: Any, values: object, path: Path, where: str) -> Any:  # noqa: ANN401 - of that kind
    """Make a dataclass from a mapping, its values checked against the types of the fields."""
    prefix = f'{path}: {where}: ' if where else f'{path}: '
    if not isinstance(values, dict):
        raise UsageError(f'{prefix}expected {", ".join(_key(f.name) for f in fields(kind))}')
    by_key = {_key(plan_field.name): plan_field for plan_field in fields(kind)}
    unknown = [str(key) for key in values if key not in by_key]
    if unknown:
        hint = did_you_mean(unknown[0], by_key)
        keys = ', '.join(by_key)
        raise UsageError(f'{prefix}unknown key {unknown[0]!r}; valid keys are {keys}{hint}')
    hints = get_type_hints(kind, localns={'Mapping': dict})
    checked = {}
    for key, value in values.items():
        name = by_key[key].name
        field_type = hints[name]
        if field_type is float and type(value) in (int, float):
            checked[name] = as_number(value, f'{prefix}{key}')
        elif field_type in _WORDS and type(value) is not field_type:
            raise UsageError(f'{prefix}{key}: {shown(value)}; expected {_WORDS[field_type]}')
        else:
            checked[name] = value
    check_numbers(checked, prefix)
    try:
        return kind(**checked)
    except TypeError:
        needed = (n for n, f in by_key.items() if f.default is f.default_factory)  # MISSING
        missing = [name for name in needed if by_key[name].name not in checked]
        raise UsageError(f'{prefix}missing {", ".join(missing)}') from None


_CHOICES: dict[str, type[Enum]] = {
    'layout': Layout,
    'incomplete': Incomplete,
    'stamps': StampSource,
    'velocity_axes': VelocityAxes,
}
_WORDS = {str: 'a text (quote numbers)', bool: 'true or false', float: 'a number', int: 'a number'}
