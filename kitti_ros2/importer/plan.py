# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion from a bag, as a user reads and edits it: topics and streams."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from enum import Enum
from math import isfinite
from typing import TYPE_CHECKING, Any, get_type_hints

from ..model.errors import UsageError
from ..model.layouts import Layout
from ..model.spelling import did_you_mean
from ..model.text import one_line
from .plan_classes import check_classes

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

TF = 'tf'
NONE = 'none'
SOURCE = 'source'
UNKNOWN_OCCLUSION = 3


class Incomplete(str, Enum):
    """The treatment of a frame in which a stream has no sample."""

    DROP = 'drop'
    KEEP = 'keep'


class StampSource(str, Enum):
    """The stamps of all streams: of the messages' headers, or their log times."""

    HEADER = 'header'
    LOG = 'log'


@dataclass(frozen=True)
class ScanPlan:
    """The source of the scans.

    Attributes:
        topic: A PointCloud2.
        frame: The frame that becomes KITTI's velodyne frame (x forward, y left, z up); points are
            brought there by the static transforms where the messages are in another.
        intensity_scale: Divisor that scales intensities to 0..1.
        minimum_range_m: Returns nearer to the scanner are dropped, metres.
        offset_s: Added to the stamps, seconds, where a clock is wrong.
    """

    topic: str
    frame: str
    intensity_scale: float = 1.0
    minimum_range_m: float = 0.0
    offset_s: float = 0.0


@dataclass(frozen=True)
class CameraPlan:
    """The source of a camera's images.

    Attributes:
        topic: An Image or CompressedImage.
        info: Its CameraInfo, empty for none.
        rectify: Whether the images are rectified.
        frame: The optical frame, empty for the CameraInfo's own.
        offset_s: As of the scan.
    """

    topic: str
    info: str = ''
    rectify: bool = False
    frame: str = ''
    offset_s: float = 0.0


@dataclass(frozen=True)
class PosePlan:
    """The source of the vehicle's poses.

    Attributes:
        topic: An Odometry, PoseStamped, Path or TFMessage.
        body: The frame whose poses they are.
        world: The frame they are given in.
        offset_s: As of the scan.
    """

    topic: str
    body: str
    world: str = ''
    offset_s: float = 0.0


@dataclass(frozen=True)
class LabelPlan:
    """The source of the labels.

    Attributes:
        topic: A Detection3DArray, TrackedObjects or DetectedObjects (Autoware), a MarkerArray
            whose cubes are the boxes, or the label lines that a bag written by to-bag contains.
        camera: The KITTI camera whose pixels the 2D boxes are.
        out_of_view: Whether boxes outside of the camera's view are kept.
        occluded: The occlusion written for boxes, whose messages have none: 0 visible, 1 partly, 2
            largely, 3 unknown. Evaluations leave 3 out (cpp/evaluate_object.cpp of the devkit).
            Label lines have their own.
        classes: KITTI's class of each class of the topic, by name (in any case) or number. Those
            that are not listed have a default: see Classes of labels of the how-to.
        keep_classes: Whether classes without one of KITTI's keep their names, such as forklift;
            otherwise they become Misc.
        offset_s: As of the scan.
    """

    topic: str
    camera: int = 2
    out_of_view: bool = False
    occluded: int = UNKNOWN_OCCLUSION
    classes: Mapping[str, str] = field(default_factory=dict)
    keep_classes: bool = False
    offset_s: float = 0.0


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
        stamps: The stamps of all streams: header, or log (the times of recording) where the clocks
            of the sensors cannot be used.
        imu_offset_s: As offset_s of the scan, for imu.
        fix_offset_s: The same for fix.
        velocity_offset_s: The same for velocity.
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
    stamps: StampSource = StampSource.HEADER
    imu_offset_s: float = 0.0
    fix_offset_s: float = 0.0
    velocity_offset_s: float = 0.0


_QUIET = frozenset(
    {'stamps', 'offset_s', 'imu_offset_s', 'fix_offset_s', 'velocity_offset_s'}
    | {'minimum_range_m', 'classes', 'keep_classes'}
)
"""Keys that a plan has only where their values are not the default."""


def format_plan(plan: Plan, notes: tuple[str, ...] = ()) -> str:
    """Format the plan as YAML, with notes as comments above; the inverse of parse_plan."""
    import yaml  # noqa: PLC0415 - 15 ms that a report of a folder does not need

    values = asdict(plan)
    values['layout'] = plan.layout.value
    values['incomplete'] = plan.incomplete.value
    values['cameras'] = dict(sorted(values['cameras'].items()))
    values['stamps'] = '' if plan.stamps is StampSource.HEADER else plan.stamps.value
    kept = {
        name: _without_defaults(value)
        for name, value in values.items()
        if value not in (None, '', {}) and not (name in _QUIET and not value)
    }
    comments = ''.join(f'# {one_line(note)}\n' for note in notes)
    return comments + yaml.safe_dump(kept, sort_keys=False, width=100)


def _without_defaults(value: Any) -> Any:  # noqa: ANN401 - of YAML
    """Leave out the quiet keys whose values are the default: 0, false or nothing."""
    if not isinstance(value, dict):
        return value
    return {
        name: each if name == 'classes' else _without_defaults(each)
        for name, each in value.items()
        if not (name in _QUIET and not each)
    }


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
    _check_parts(made, path)
    for name, choice in (('layout', Layout), ('incomplete', Incomplete), ('stamps', StampSource)):
        if name in made:
            made[name] = _choose(choice, made[name], f'{path}: {name}')
    plan: Plan = _make(Plan, made, path, '')
    return plan


def _check_parts(made: dict[str, Any], path: Path) -> None:
    """Check the values of scan and labels; classes get KITTI's spelling."""
    scan, labels = made.get('scan'), made.get('labels')
    if scan is not None and scan.minimum_range_m < 0:
        raise UsageError(
            f'{path}: scan: minimum_range_m: {scan.minimum_range_m}; expected 0 or more'
        )
    if labels is None:
        return
    if labels.occluded not in range(UNKNOWN_OCCLUSION + 1):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    where = f'{path}: labels: classes'
    classes = check_classes(labels.classes, where, any_word=labels.keep_classes)
    made['labels'] = replace(labels, classes=classes)


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
        raise UsageError(f'{place}expected {", ".join(f.name for f in fields(kind))}')
    known = {each.name: each for each in fields(kind)}
    unknown = [str(key) for key in values if key not in known]
    if unknown:
        hint = did_you_mean(unknown[0], known)
        keys = ', '.join(known)
        raise UsageError(f'{place}unknown key {unknown[0]!r}; valid keys are {keys}{hint}')
    hints = get_type_hints(kind, localns={'Mapping': dict})
    checked = {}
    for name, value in values.items():
        wanted = hints[name]
        if wanted is float and type(value) is int:
            checked[name] = float(value)
        elif wanted is float and type(value) is float and not isfinite(value):
            raise UsageError(f'{place}{name}: {value}; expected a finite number')
        elif wanted in _WORDS and type(value) is not wanted:
            raise UsageError(f'{place}{name}: {value!r}; expected {_WORDS[wanted]}')
        else:
            checked[name] = value
    try:
        return kind(**checked)
    except TypeError:
        needed = (n for n, each in known.items() if each.default is each.default_factory)  # MISSING
        missing = [name for name in needed if name not in checked]
        raise UsageError(f'{place}missing {", ".join(missing)}') from None


_WORDS = {str: 'a text (quote numbers)', bool: 'true or false', float: 'a number', int: 'a number'}
