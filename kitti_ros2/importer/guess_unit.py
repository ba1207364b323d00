# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topics and the frame of the GPS/IMU unit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model import msgtypes as types
from ..rig.tf_tree import FrameTree
from .report import pass_over

if TYPE_CHECKING:
    from .plan import ScanPlan
    from .survey import Survey


def guess_unit(survey: Survey, notes: list[str], *, posed: bool = False) -> dict[str, str]:
    """Choose the topics of the GPS/IMU unit, by their keys in the plan.

    Args:
        survey: Of the bags.
        notes: Takes what is missing.
        posed: Whether the plan has poses, which take the place of a fix.
    """
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
        place = 'the poses, from origin of the plan on' if posed else 'origin of the plan'
        notes.append(f'missing: fix (NavSatFix); the position in oxts is that of {place}')
    for key, msgtype in (('imu', 'Imu'), ('velocity', 'TwistStamped')):
        if key not in found and not (posed and key == 'velocity'):
            notes.append(f'missing: {key} ({msgtype}); its columns of oxts are 0')
    return found


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
