# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topics and the frame of the GPS/IMU unit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ..messages.header import vector_of
from ..messages.oxts import has_orientation
from ..model import msgtypes as types
from ..rig.heading import find_body
from .guess_names import is_fixed
from .named_frames import child_of
from .plan import VelocityAxes
from .report import pass_over
from .scan_frame import describe_axes, forward_frame, is_forward, near_frame

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from ..rig.heading import Heading
    from ..rig.tf_tree import FrameTree
    from .plan import PosePlan, ScanPlan
    from .survey import Survey
    from .topic_survey import TopicSurvey


def has_place(survey: Survey, scan: ScanPlan | None) -> bool:
    """Whether a receiver of the vehicle has a fix."""
    return any(each.has_fix for each in _of_vehicle(survey, types.FIX, scan))


def guess_unit(
    survey: Survey, scan: ScanPlan | None, notes: list[str], pose: PosePlan | None = None
) -> dict[str, str]:
    """Choose the topics of the GPS/IMU unit, by their keys in the plan.

    Args:
        survey: Of the bags.
        scan: The scans, whose vehicle it is of.
        notes: Takes what is missing.
        pose: The plan's poses, which take the place of a fix.
    """
    found = _best_topics(survey, scan, pose, notes)
    if 'fix' not in found and pose is None and 'imu' not in found:
        notes.append('missing: fix (NavSatFix), imu and poses, so oxts is left out')
        return {}
    if 'fix' not in found:
        if pose is not None:
            found |= _odometry(survey, pose)
        place = 'origin of the plan' if pose is None else 'the poses, from origin of the plan on'
        notes.append(f'missing: fix (NavSatFix); the position in oxts is that of {place}')
    elif 'imu' in found and not ('velocity' in found and survey.topics[found['velocity']].moves):
        found |= _odometry_of(survey, survey.topics[found['imu']].frame)
    placed = 'fix' in found or pose is not None
    for key, msgtype, rest in (
        ('imu', 'Imu', 'its columns of oxts are 0'),
        ('velocity', 'TwistStamped', 'in oxts it is derived from the places' if placed else ''),
    ):
        if key not in found:
            notes.append(f'missing: {key} ({msgtype}); {rest or "its columns of oxts are 0"}')
    return found


def _best_topics(
    survey: Survey, scan: ScanPlan | None, pose: PosePlan | None, notes: list[str]
) -> dict[str, str]:
    """Return the topics of the unit by their keys, and note those that are passed over."""
    found: dict[str, str] = {}
    joined = _joined_frames(survey, scan)
    for key, msgtype, rank in (
        ('imu', types.IMU, partial(_imu_rank, joined=joined)),
        ('fix', types.FIX, _fix_rank),
        ('velocity', types.TWIST, _velocity_rank),
    ):
        topics = _of_vehicle(survey, msgtype, scan)
        if key == 'velocity':
            topics = _in_known_axes(topics, survey, joined, pose, found)
        notes += [
            f'passed over for {key}: {each.name} ({each.count}); no transform joins its frame,'
            f' {each.frame}, to that of the scans'
            for each in survey.of_type(msgtype)
            if each not in topics
        ]
        if not topics:
            continue
        best = max(topics, key=rank)
        notes += pass_over(key, best, topics)
        if key == 'fix' and not best.has_fix:
            notes.append(f'passed over for fix: {best.name} ({best.count}); it never has a fix')
        else:
            found[key] = best.name
    return found


def _joined_frames(survey: Survey, scan: ScanPlan | None) -> frozenset[str]:
    """Return the frames that static transforms join to the scans'."""
    if scan is None:
        return frozenset()
    tree = survey.tree
    known = {*tree.frames, scan.frame}
    return frozenset(each for each in known if tree.joins(scan.frame, each))


def _in_known_axes(
    topics: list[TopicSurvey],
    survey: Survey,
    joined: Collection[str],
    pose: PosePlan | None,
    unit: Mapping[str, str],
) -> list[TopicSurvey]:
    """Return the velocities that can be turned into the axes of the unit, if that has a place."""
    imu, fix = (survey.topics[unit[key]].frame if key in unit else '' for key in ('imu', 'fix'))
    has_place = imu in joined if 'imu' in unit else pose is not None and pose.body in joined
    if not has_place:
        return topics
    known = {'', fix, *joined}
    return [each for each in topics if each.frame in known or is_fixed(each.frame)]


def _of_vehicle(survey: Survey, msgtype: str, scan: ScanPlan | None) -> list[TopicSurvey]:
    """Return the topics of a type but those of another robot.

    Its frames have another prefix (robot2/base_link), and no transform joins them to the scans'.
    """
    tree, own = survey.tree, '' if scan is None else scan.frame
    found = []
    for each in survey.of_type(msgtype):
        known = {own, each.frame} <= tree.frames
        prefixes = own.rpartition('/')[0], each.frame.rpartition('/')[0]
        apart = known and all(prefixes) and prefixes[0] != prefixes[1]
        if not apart or tree.root_of(own) == tree.root_of(each.frame):
            found.append(each)
    return found


def _imu_rank(topic: TopicSurvey, joined: Collection[str]) -> tuple[bool, bool, bool, bool, int]:
    """Rank an Imu: in a joined frame, with an orientation, not raw, with values, of most."""
    oriented = any(map(has_orientation, topic.looks))
    rates = (each.angular_velocity for each in topic.looks)
    forces = (each.linear_acceleration for each in topic.looks)
    measured = any(vector_of(each).any() for each in (*rates, *forces))
    return topic.frame in joined, oriented, 'raw' not in topic.name, measured, topic.count


def _fix_rank(topic: TopicSurvey) -> tuple[bool, bool, int]:
    """Rank a NavSatFix: with a fix, not raw, of most messages."""
    return topic.has_fix, 'raw' not in topic.name, topic.count


def _velocity_rank(topic: TopicSurvey) -> tuple[bool, bool, int]:
    return 'cmd' not in topic.name, topic.moves, topic.count


def _odometry(survey: Survey, pose: PosePlan) -> dict[str, str]:
    """Return the Odometry whose twist is the velocity: that of the poses, or of the same body."""
    tree = survey.tree
    topics = [
        each
        for each in survey.of_type(types.ODOMETRY)
        if each.name == pose.topic
        or child_of(each) == pose.body
        or tree.joins(pose.body, child_of(each))
    ]
    if not topics:
        return {}
    return {'velocity': max(topics, key=lambda each: (each.name == pose.topic, each.count)).name}


def _odometry_of(survey: Survey, frame: str) -> dict[str, str]:
    """Return the Odometry with a twist whose body static transforms join to a frame."""
    tree = survey.tree
    topics = [
        each
        for each in survey.of_type(types.ODOMETRY)
        if child_of(each) in tree.frames and tree.joins(frame, child_of(each)) and each.moves
    ]
    return {'velocity': max(topics, key=lambda each: each.count).name} if topics else {}


def guess_velocity_axes(survey: Survey, unit: Mapping[str, str], notes: list[str]) -> VelocityAxes:
    """Choose the axes of a TwistStamped by its frame.

    Receivers with one antenna do not know where it looks: the velocity of nmea_navsat_driver and
    others, in the frame of their NavSatFix, is along east and north. That in a fixed frame (mavros'
    velocity_local, in map) is along its axes, which REP 103 has as east, north, up.
    """
    topic = survey.topics.get(unit.get('velocity', ''))
    if topic is None or topic.msgtype != types.TWIST or not topic.frame:
        return VelocityAxes.FRAME
    fixed = is_fixed(topic.frame)
    fix, imu = (survey.topics[unit[key]].frame if key in unit else '' for key in ('fix', 'imu'))
    if not fixed and (topic.frame != fix or topic.frame == imu):
        return VelocityAxes.FRAME
    why = 'which does not move' if fixed else f'that of {unit["fix"]}'
    notes.append(
        f'{topic.name}: its frame is {topic.frame}, {why}, so it is taken as along east, north and'
        f' up (velocity_axes)'
    )
    return VelocityAxes.ENU


def guess_imu_frame(
    survey: Survey, imu: str, scan: ScanPlan | None, heading: Heading | None, notes: list[str]
) -> str:
    """Return the frame of the Imu if static transforms connect it to the scans'.

    It is one with x forward, y left and z up, as KITTI's.

    Args:
        survey: Of the bags.
        imu: The topic of the plan, empty for none.
        scan: The scans.
        heading: The robot's forward; None where it is unknown.
        notes: A note is added.
    """
    topics = _of_vehicle(survey, types.IMU, scan)
    if not topics or scan is None:
        return ''
    joined = _joined_frames(survey, scan)
    chosen = max(topics, key=lambda each: (each.name == imu, _imu_rank(each, joined)))
    if chosen.frame in joined:
        tree = survey.tree
        return _forward_frame(chosen.frame, tree, find_body(tree, [chosen.frame]) or heading, notes)
    notes.append(
        f'missing: a static transform from {chosen.frame} to {scan.frame}; the imu frame is'
        f' nominal until imu_frame names a frame that is joined'
    )
    return ''


def _forward_frame(frame: str, tree: FrameTree, heading: Heading | None, notes: list[str]) -> str:
    """Return the frame of the Imu, or one near it or the body's where its x is not forward."""
    axes = None if heading is None else heading.axes_of(tree, frame)
    if heading is None or axes is None or is_forward(axes):
        return frame
    told = f'the Imu is in {frame}, {describe_axes(axes, heading)}; KITTI has x forward'
    found = near_frame(frame, tree, heading) or forward_frame(frame, tree, heading)
    if found:
        notes.append(f'{told}: imu_frame is {found}, and oxts is turned to it')
        return found
    notes.append(f'{told}, and so has no frame of the bag: oxts is along the axes of {frame}')
    return frame


def guess_unit_frame(survey: Survey, scan: ScanPlan | None, pose: PosePlan) -> str:
    """Return the frame whose poses become oxts if static transforms connect it to the scans'."""
    tree = survey.tree
    joined = scan is not None and tree.joins(scan.frame, pose.body)
    return pose.body if joined else ''
