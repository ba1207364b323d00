# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topics and the frame of the GPS/IMU unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model import msgtypes as types
from ..rig.tf_tree import FrameTree
from .named_frames import child_of
from .report import pass_over

if TYPE_CHECKING:
    from .plan import PosePlan, ScanPlan
    from .survey import Survey


def guess_unit(survey: Survey, notes: list[str], pose: PosePlan | None = None) -> dict[str, str]:
    """Choose the topics of the GPS/IMU unit, by their keys in the plan.

    Args:
        survey: Of the bags.
        notes: Takes what is missing.
        pose: The plan's poses, which take the place of a fix.
    """
    posed = pose is not None
    found: dict[str, str] = {}
    for key, msgtype, avoid in (
        ('imu', types.IMU, 'raw'),
        ('fix', types.FIX, 'raw'),
        ('velocity', types.TWIST, 'cmd'),
    ):
        topics = survey.of_type(msgtype)
        plain = [each for each in topics if avoid not in each.name] or topics
        if plain:
            best = max(plain, key=lambda each: each.count)
            notes += pass_over(key, best, topics)
            found[key] = best.name
    if 'fix' not in found and not posed and 'imu' not in found:
        notes.append('missing: fix (NavSatFix), imu and poses, so oxts is left out')
        return {}
    if 'fix' not in found:
        if pose is not None:
            found |= _odometry(survey, pose)
        place = 'the poses, from origin of the plan on' if posed else 'origin of the plan'
        notes.append(f'missing: fix (NavSatFix); the position in oxts is that of {place}')
    for key, msgtype in (('imu', 'Imu'), ('velocity', 'TwistStamped')):
        if key not in found:
            notes.append(f'missing: {key} ({msgtype}); its columns of oxts are 0')
    return found


def _odometry(survey: Survey, pose: PosePlan) -> dict[str, str]:
    """Return the Odometry whose twist is the velocity: that of the poses, or of the same body."""
    tree = FrameTree(survey.static, survey.moving)
    topics = [
        each
        for each in survey.of_type(types.ODOMETRY)
        if each.name == pose.topic
        or child_of(each) == pose.body
        or tree.find(pose.body, child_of(each)) is not None
    ]
    if not topics:
        return {}
    return {'velocity': max(topics, key=lambda each: (each.name == pose.topic, each.count)).name}


def guess_imu_frame(survey: Survey, scan: ScanPlan | None, notes: list[str]) -> str:
    """Return the frame of the Imu if static transforms connect it to the scans'."""
    frames = [each.frame for each in survey.of_type(types.IMU)]
    if not frames or scan is None:
        return ''
    tree = FrameTree(survey.static, survey.moving)
    for frame in frames:
        if tree.find(scan.frame, frame) is not None:
            return frame
    notes.append(
        f'missing: a static transform from {frames[0]} to {scan.frame}; the imu frame is'
        f' nominal until imu_frame names a frame that is joined'
    )
    return ''


def guess_unit_frame(survey: Survey, scan: ScanPlan | None, pose: PosePlan) -> str:
    """Return the frame whose poses become oxts if static transforms connect it to the scans'."""
    tree = FrameTree(survey.static, survey.moving)
    joined = scan is not None and tree.find(scan.frame, pose.body) is not None
    return pose.body if joined else ''
