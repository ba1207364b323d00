# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion from a bag, as a user reads and edits it: topics and streams."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, get_type_hints

from ..messages.scan_sources import SCAN_SOURCES
from ..messages.velodyne_models import MODELS
from ..model.errors import UsageError
from ..model.layouts import Layout
from ..model.spelling import did_you_mean
from ..model.text import one_line

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

TF = 'tf'
NONE = 'none'
SOURCE = 'source'
UNKNOWN_OCCLUSION = 3


_QUIET = 'quiet'


def _quiet(value: Any) -> Any:  # noqa: ANN401 - of the field
    """Make a field that format_plan leaves out at its default."""
    return field(default=value, metadata={_QUIET: True})


class Incomplete(str, Enum):
    """The treatment of a frame in which a stream has no sample."""

    DROP = 'drop'
    KEEP = 'keep'


@dataclass(frozen=True)
class ScanPlan:
    """The source of the scans.

    Attributes:
        topic: A PointCloud2, CustomMsg (Livox), VelodyneScan, LaserScan or depth image.
        frame: The frame that becomes KITTI's velodyne frame (x forward, y left, z up); points are
            brought there by the static transforms where the messages are in another.
        intensity_scale: Divisor that scales intensities to 0..1.
        from_: What the scans are made from: cloud, livox, velodyne, laser_scan or depth; empty for
            what the topic's type is of.
        info: The CameraInfo of depth images, empty for none.
        model: The scanner of Velodyne packets: VLP-16, VLP-16-Hi-Res, VLP-32C, HDL-32E or HDL-64E;
            empty for the one that the packets name.
        calibration: The YAML file with the calibration of the scanner's unit, as the ROS driver
            reads it; required for a HDL-64E, empty for the angles of the model's manual.
    """

    topic: str
    frame: str
    intensity_scale: float = 1.0
    from_: str = _quiet('')
    info: str = _quiet('')
    model: str = _quiet('')
    calibration: str = _quiet('')


@dataclass(frozen=True)
class CameraPlan:
    """The source of a camera's images.

    Attributes:
        topic: An Image or CompressedImage.
        info: Its CameraInfo, empty for none.
        rectify: Whether the images are rectified.
        frame: The optical frame, empty for the CameraInfo's own.
    """

    topic: str
    info: str = ''
    rectify: bool = False
    frame: str = ''


@dataclass(frozen=True)
class PosePlan:
    """The source of the vehicle's poses.

    Attributes:
        topic: An Odometry, PoseStamped, Path or TFMessage.
        body: The frame whose poses they are.
        world: The frame they are given in.
    """

    topic: str
    body: str
    world: str = ''


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
            Label lines have their own.
        boxes_2d: A Detection2DArray whose boxes are the 2D boxes of the labels, in pixels of the
            camera's images as they are in the bag; empty: the projections of the 3D boxes.
    """

    topic: str
    camera: int = 2
    out_of_view: bool = False
    occluded: int = UNKNOWN_OCCLUSION
    boxes_2d: str = _quiet('')


@dataclass(frozen=True)
class Plan:
    """The rules by which bags are converted to a KITTI recording.

    Attributes:
        layout: Which of the four.
        name: Drive (2011_09_26_drive_0001_sync), split or sequence.
        reference: The stream whose samples are the frames: scan, image_N or pose.
        tolerance_s: Maximum distance of a sample from the stamp of its frame, seconds.
        incomplete: Whether frames with a missing sample are dropped or kept.
        scan: The source of the scans.
        cameras: The sources of images, by KITTI camera number.
        pose: The source of the poses.
        labels: The source of the labels.
        imu: Topic of an Imu for the packets of the GPS/IMU unit, empty for none.
        fix: Topic of a NavSatFix for the same, empty for none.
        velocity: Topic of a TwistStamped for the same, empty for none.
        imu_frame: The frame that becomes KITTI's imu frame (x forward, y left, z up).
        calibration: tf (CameraInfo and static transforms), source (the files in a bag written by
            to-bag), none, or a KITTI calibration file or folder.
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
    imu_frame: str = ''
    calibration: str = TF


def format_plan(plan: Plan, notes: tuple[str, ...] = ()) -> str:
    """Format the plan as YAML, with notes as comments above; the inverse of parse_plan."""
    import yaml  # noqa: PLC0415 - 15 ms that a report of a folder does not need

    values = _values(plan)
    values['layout'] = plan.layout.value
    values['incomplete'] = plan.incomplete.value
    values['cameras'] = dict(sorted(values['cameras'].items()))
    kept = {name: value for name, value in values.items() if value not in (None, '', {})}
    comments = ''.join(f'# {one_line(note)}\n' for note in notes)
    return comments + yaml.safe_dump(kept, sort_keys=False, width=100)


def _values(part: Any) -> dict[str, Any]:  # noqa: ANN401 - of a plan
    """Return a dataclass as a mapping, keys as in YAML, without quiet fields at their default."""
    found = {}
    for each in fields(part):
        value = getattr(part, each.name)
        if each.metadata.get(_QUIET) and value == each.default:
            continue
        if is_dataclass(value):
            value = _values(value)
        elif isinstance(value, dict):
            value = {
                key: _values(item) if is_dataclass(item) else item for key, item in value.items()
            }
        found[_key(each.name)] = value
    return found


def _key(name: str) -> str:
    """Return the key of a field: from of from_, which Python has a word for."""
    return name.rstrip('_')


def parse_plan(text: str, path: Path) -> Plan:
    """Parse a plan from YAML.

    Raises:
        UsageError: It is not a valid plan; the error names the key.
    """
    import yaml  # noqa: PLC0415 - as above

    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise UsageError(f'{path}: is not valid YAML ({" ".join(str(error).split())})') from error
    if not isinstance(values, dict):
        raise UsageError(f'{path}: is not a plan; expected the output of to-kitti --plan')
    made = dict(values)
    cameras = made.pop('cameras', None) or {}
    if not isinstance(cameras, dict) or not all(key in range(5) for key in cameras):
        raise UsageError(f'{path}: cameras: expected KITTI camera numbers 0 to 4, found {cameras}')
    made['cameras'] = {
        key: _make(CameraPlan, value, path, f'cameras: {key}') for key, value in cameras.items()
    }
    for name, kind in (('scan', ScanPlan), ('pose', PosePlan), ('labels', LabelPlan)):
        if made.get(name) is not None:
            made[name] = _make(kind, made[name], path, name)
    _check_scan(made.get('scan'), path)
    labels = made.get('labels')
    if labels is not None and labels.occluded not in range(UNKNOWN_OCCLUSION + 1):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    for name, choice in (('layout', Layout), ('incomplete', Incomplete)):
        if name in made:
            made[name] = _choose(choice, made[name], f'{path}: {name}')
    plan: Plan = _make(Plan, made, path, '')
    return plan


def _check_scan(scan: ScanPlan | None, path: Path) -> None:
    words = {'from': [each.word for each in SCAN_SOURCES], 'model': list(MODELS)}
    for key, known in words.items():
        value = '' if scan is None else getattr(scan, 'from_' if key == 'from' else key)
        if value and value not in known:
            hint = did_you_mean(value, known)
            expected = ', '.join(known)
            raise UsageError(f'{path}: scan: {key}: {value!r}; expected one of {expected}{hint}')


def _choose(kind: type[Enum], value: object, where: str) -> Enum:
    try:
        return kind(value)
    except ValueError:
        known = [str(each.value) for each in kind]
        hint = did_you_mean(str(value), known)
        raise UsageError(f'{where}: {value!r}; expected {" or ".join(known)}{hint}') from None


def _make(kind: Any, values: object, path: Path, where: str) -> Any:  # noqa: ANN401 - of that kind
    """Make a dataclass from a mapping, its values checked against the types of the fields."""
    place = f'{path}: {where}: ' if where else f'{path}: '
    if not isinstance(values, dict):
        raise UsageError(f'{place}expected {", ".join(_key(f.name) for f in fields(kind))}')
    known = {_key(each.name): each for each in fields(kind)}
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        hint = did_you_mean(unknown[0], known)
        keys = ', '.join(known)
        raise UsageError(f'{place}unknown key {unknown[0]!r}; valid keys are {keys}{hint}')
    hints = get_type_hints(kind, localns={'Mapping': dict})
    checked = {}
    for key, value in values.items():
        name = known[key].name
        wanted = hints[name]
        if wanted is float and type(value) is int:
            checked[name] = float(value)
        elif wanted in _WORDS and type(value) is not wanted:
            raise UsageError(f'{place}{key}: {value!r}; expected {_WORDS[wanted]}')
        else:
            checked[name] = value
    try:
        return kind(**checked)
    except TypeError:
        needed = (n for n, each in known.items() if each.default is each.default_factory)  # MISSING
        missing = [name for name in needed if known[name].name not in checked]
        raise UsageError(f'{place}missing {", ".join(missing)}') from None


_WORDS = {str: 'a text (quote numbers)', bool: 'true or false', float: 'a number', int: 'a number'}
