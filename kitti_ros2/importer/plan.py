# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion from a bag, as a user reads and edits it: topics and streams."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import TYPE_CHECKING, Any, get_type_hints

from ..model.errors import UsageError
from ..model.geographic import GeoOrigin
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


class Incomplete(str, Enum):
    """The treatment of a frame in which a stream has no sample."""

    DROP = 'drop'
    KEEP = 'keep'


@dataclass(frozen=True)
class ScanPlan:
    """The source of the scans.

    Attributes:
        topic: A PointCloud2.
        frame: The frame that becomes KITTI's velodyne frame (x forward, y left, z up); points are
            brought there by the static transforms where the messages are in another.
        intensity_scale: Divisor that scales intensities to 0..1.
    """

    topic: str
    frame: str
    intensity_scale: float = 1.0


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
        body: The frame whose poses they are: of Odometry its child frame, or one that transforms
            join to it.
        world: The frame they are given in: that of the messages, or one that transforms join to it,
            such as map above odom.
    """

    topic: str
    body: str
    world: str = ''


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
    """

    topic: str
    camera: int = 2
    out_of_view: bool = False
    occluded: int = UNKNOWN_OCCLUSION


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
        velocity: Topic of a TwistStamped or an Odometry for the same, empty for none.
        imu_frame: The frame that becomes KITTI's imu frame (x forward, y left, z up).
        calibration: tf (CameraInfo and static transforms), source (the files in a bag written by
            to-bag), none, or a KITTI calibration file or folder.
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
    imu_frame: str = ''
    calibration: str = TF
    origin: str = ''


def format_plan(plan: Plan, notes: tuple[str, ...] = ()) -> str:
    """Format the plan as YAML, with notes as comments above; the inverse of parse_plan."""
    import yaml  # noqa: PLC0415 - 15 ms that a report of a folder does not need

    values = asdict(plan)
    values['layout'] = plan.layout.value
    values['incomplete'] = plan.incomplete.value
    values['cameras'] = dict(sorted(values['cameras'].items()))
    kept = {name: value for name, value in values.items() if value not in (None, '', {})}
    comments = ''.join(f'# {one_line(note)}\n' for note in notes)
    return comments + yaml.safe_dump(kept, sort_keys=False, width=100)


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
    labels = made.get('labels')
    if labels is not None and labels.occluded not in range(UNKNOWN_OCCLUSION + 1):
        raise UsageError(f'{path}: labels: occluded: {labels.occluded}; expected 0 to 3')
    for name, choice in (('layout', Layout), ('incomplete', Incomplete)):
        if name in made:
            made[name] = _choose(choice, made[name], f'{path}: {name}')
    plan: Plan = _make(Plan, made, path, '')
    _check_origin(plan.origin, path)
    return plan


def _check_origin(text: str, path: Path) -> None:
    try:
        GeoOrigin.parse(text)
    except ValueError as error:
        raise UsageError(f'{path}: origin: {error}') from None


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
