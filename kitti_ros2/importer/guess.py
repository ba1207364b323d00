# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detection of the KITTI stream of each topic: by type, name, frame and neighbours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from ..messages.scan_sources import SCAN_TYPES
from ..model import msgtypes as types
from ..model.errors import MissingDataError, UsageError
from ..model.stamps import NS_PER_S, format_stamp
from ..model.streams import Stream
from .camera_geometry import find_heading, with_frames
from .camera_topics import find_cameras
from .clock_offsets import estimate_offsets
from .clocks import clocked
from .convert_scans import cloud_notes
from .guess_cameras import guess_camera_sets, guess_cameras, keeps_distortion, main_camera
from .guess_labels import guess_labels
from .guess_pose import guess_pose
from .guess_scan import guess_scan
from .guess_unit import (
    guess_imu_frame,
    guess_unit,
    guess_unit_frame,
    guess_velocity_axes,
    has_place,
)
from .named_frames import NamedFrames, moving_pairs
from .optical_frames import optical_link
from .plan import NONE, SOURCE, TF, Incomplete, Plan
from .report import undecoded
from .scan_frame import face_forward
from .sync import default_tolerance_ns

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.layouts import Layout
    from ..model.losses import Loss
    from ..model.samples import Int64Array
    from ..rig.heading import Heading
    from .plan import CameraPlan, PosePlan, ScanPlan
    from .survey import Survey

_DEFAULT_TOLERANCE_S = 0.05
_MOST_SHOWN = 8


@dataclass(frozen=True)
class Guess:
    """A plan with notes.

    Attributes:
        plan: The plan.
        notes: Missing and skipped topics; a line each.
        losses: Topics that the plan would name if any of their messages could be decoded.
    """

    plan: Plan
    notes: tuple[str, ...]
    losses: tuple[Loss, ...] = ()


def guess_plan(
    survey: Survey,
    layout: Layout,
    path: Path,
    *,
    all_cameras: bool = False,
    with_calibration: bool = False,
) -> Guess:
    """Make the most complete plan for a bag.

    Args:
        survey: Of the bag.
        layout: The layout to write.
        path: Of the bag, for errors.
        all_cameras: Whether each camera gets a data set of its own.
        with_calibration: Whether one is given: it is for scans in the frame of their messages, so
            that they stay in it, also where its x is not forward.

    Raises:
        MissingDataError: It contains no data that the layout requires.
    """
    traits, notes = layout.traits, list[str]()
    sensors = _find_sensors(
        survey, layout, notes, all_cameras=all_cameras, with_calibration=with_calibration
    )
    if not any(sensors[:-1]):
        raise MissingDataError(f'{path}: {_nothing(survey, layout)}')
    scan, cameras, sets, pose, _ = sensors
    viewed = cameras or dict(zip((2,), sets.values(), strict=False))
    reference, topic = _reference(scan, viewed, pose)
    stamps, _ = survey.topics[topic].stamps()
    unit = guess_unit(survey, scan, notes, pose) if Stream.OXTS in traits.streams else {}
    imu_frame = _imu_frame(survey, layout, sensors, unit, notes)
    labels = None
    if Stream.LABELS in traits.streams:
        tree = survey.tree
        labels = guess_labels(survey, tree, viewed, notes, layout)
    extract = keeps_distortion(survey, (sets or cameras).values())
    plan = Plan(
        layout=layout,
        name=_name(layout, int(stamps[0]), extract=extract),
        reference=reference,
        tolerance_s=_tolerance_s(stamps),
        incomplete=Incomplete.KEEP if traits.stamps_per_stream else Incomplete.DROP,
        scan=scan,
        cameras=cameras,
        pose=pose,
        labels=labels,
        imu_frame=imu_frame,
        calibration=_calibration(survey, viewed, [] if with_calibration else notes),
        imu=unit.get('imu', ''),
        fix=unit.get('fix', ''),
        velocity=unit.get('velocity', ''),
        velocity_axes=guess_velocity_axes(survey, unit, notes),
        camera_sets=sets,
    )
    if scan is not None:
        notes += cloud_notes(scan, survey.topics[scan.topic], point_labels=traits.point_labels)
    plan, offsets = _with_offsets(survey, plan)
    if offsets:
        stamps, _ = clocked(survey, plan).topics[topic].stamps()
        plan = replace(plan, name=_name(layout, int(stamps[0]), extract=extract))
        notes += offsets
    return Guess(plan, tuple(notes), _unreadable(survey, layout, scans=plan.scan is None))


def _with_offsets(survey: Survey, plan: Plan) -> tuple[Plan, list[str]]:
    """Set the offsets of clocks; scans and boxes in frames that move need that of the links, too.

    It is the offset of the plan's poses, which a plan may have for this alone.
    """
    links, alone = (None, False) if plan.pose is not None else _links(survey, plan)
    found, notes = estimate_offsets(survey, replace(plan, pose=plan.pose or links))
    if links is not None and alone:
        notes.insert(0, f'poses: {links.topic}, which alone joins {links.world} to {links.body}')
    needs_links = found.pose is not None and found.pose.offset_s
    return (found if needs_links or alone or links is None else replace(found, pose=None)), notes


def _links(survey: Survey, plan: Plan) -> tuple[PosePlan | None, bool]:
    """Return the poses by which scans and boxes in frames that move are placed, None without such.

    Also whether they are needed: transforms and Odometry are links by themselves, a PoseStamped is
    one where a plan names it.
    """
    links = guess_pose(survey, [])
    joined, more = (
        len(moving_pairs(plan, survey, NamedFrames(survey, pose))) for pose in (None, links)
    )
    return (links if more else None), more > joined


class _Sensors(NamedTuple):
    """The parts of a plan that can be its reference; a plan has one of them at least."""

    scan: ScanPlan | None
    cameras: dict[int, CameraPlan]
    camera_sets: dict[str, CameraPlan]
    pose: PosePlan | None
    heading: Heading | None


def _find_sensors(
    survey: Survey, layout: Layout, notes: list[str], *, all_cameras: bool, with_calibration: bool
) -> _Sensors:
    """Return the sensors of a bag that a layout has a place for; see guess_plan."""
    rig = find_cameras(survey)
    scan = guess_scan(survey, rig, notes)
    tree = survey.tree
    heading = find_heading(tree, None if scan is None else scan.frame, rig)
    if scan is not None and not survey.calibrations and not with_calibration:
        scan = face_forward(scan, tree, heading, notes)
    rig = with_frames(rig, tree, heading, notes)
    links = [optical_link(each.bag_frame, each.forward) for each in rig if each.forward]
    tree = survey.tree_with(links)
    sets: dict[str, CameraPlan] = {}
    frame = None if scan is None else scan.frame
    if all_cameras:
        sets = guess_camera_sets(layout, rig, tree, heading, frame, notes)
    cameras = guess_cameras(layout, rig, tree, heading, frame, notes) if not sets else {}
    streams = layout.traits.streams
    # Poses take the place of a missing fix.
    placed = Stream.OXTS in streams and not has_place(survey, scan)
    pose = guess_pose(survey, notes) if Stream.POSE in streams or placed else None
    return _Sensors(scan, cameras, sets, pose, heading)


def _imu_frame(
    survey: Survey, layout: Layout, sensors: _Sensors, unit: Mapping[str, str], notes: list[str]
) -> str:
    """Return the frame of the GPS/IMU unit, that of the poses in place of one; empty without."""
    frame = guess_imu_frame(survey, unit.get('imu', ''), sensors.scan, sensors.heading, notes)
    if frame or unit.get('imu') or sensors.pose is None or Stream.OXTS not in layout.traits.streams:
        return frame
    return guess_unit_frame(survey, sensors.scan, sensors.pose)


def _tolerance_s(stamps_ns: Int64Array) -> float:
    """Return how far samples may be from the frames of a reference, (N,) nanoseconds."""
    if len(stamps_ns) > 1:
        return default_tolerance_ns(stamps_ns) / NS_PER_S
    return _DEFAULT_TOLERANCE_S


def _calibration(survey: Survey, cameras: dict[int, CameraPlan], notes: list[str]) -> str:
    """Choose the calibration: the files in a bag written by to-bag, else the CameraInfos."""
    if survey.calibrations and cameras:
        return SOURCE
    if any(plan.info for plan in cameras.values()):
        return TF
    lacking = 'camera_info' if cameras else 'camera'
    notes.append(f'missing: calibration (no {lacking}); --calib FILE gives it')
    return NONE


def _nothing(survey: Survey, layout: Layout) -> str:
    """Describe the content of a bag that has no data that a layout requires."""
    there = [f'{each.name} ({each.msgtype})' for each in survey.topics.values() if each.count]
    reasons = [loss.text() for loss in _unreadable(survey, layout, scans=True)]
    reasons += [*survey.losses, *survey.notes]
    reason = f' ({reasons[0]})' if reasons else ''
    if not there:
        return f'the bag has no message{reason}'
    needed = 'no point cloud and no image'
    if Stream.POSE in layout.traits.streams:
        needed += ', and no poses either'
    more = f' and {len(there) - _MOST_SHOWN} more' if len(there) > _MOST_SHOWN else ''
    return f'the bag has {needed}; it has {", ".join(there[:_MOST_SHOWN])}{more}{reason}'


def _unreadable(survey: Survey, layout: Layout, *, scans: bool) -> tuple[Loss, ...]:
    """Return the topics of types that a layout supports of which no message can be read.

    Those that scans are made from in place of clouds are included if scans are missing.
    """
    wanted = {types.CLOUD, types.IMAGE, types.COMPRESSED, types.CAMERA_INFO}
    wanted |= SCAN_TYPES if scans else set()
    if Stream.POSE in layout.traits.streams:
        wanted |= {types.ODOMETRY, types.POSE, types.PATH}
    if Stream.LABELS in layout.traits.streams:
        wanted |= {types.DETECTIONS_3D, types.TRACKED_OBJECTS, types.DETECTED_OBJECTS}
        wanted |= {types.MARKERS}
    if Stream.OXTS in layout.traits.streams:
        wanted |= {types.IMU, types.FIX, types.TWIST}
    left_out = (
        loss for channel, loss in survey.left_out if channel.msgtype in wanted and loss.count
    )
    return (
        *(undecoded(topic) for topic in survey.unreadable(*wanted)),
        *left_out,
    )


def _reference(
    scan: ScanPlan | None, cameras: dict[int, CameraPlan], pose: PosePlan | None
) -> tuple[str, str]:
    if scan is not None:
        return Stream.SCAN.value, scan.topic
    if cameras:
        return f'image_{main_camera(cameras)}', cameras[main_camera(cameras)].topic
    if pose is None:
        raise UsageError('a plan needs a scan, a camera or poses')
    return Stream.POSE.value, pose.topic


def _name(layout: Layout, first_ns: int, *, extract: bool) -> str:
    date = format_stamp(first_ns)[: len('2011-09-26')].replace('-', '_')
    return layout.traits.default_name.format(date=date, kind='extract' if extract else 'sync')
