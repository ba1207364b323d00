# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the scans' topic; scan_frame chooses the frame that becomes KITTI's."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from ..messages.clouds import guess_intensity_scale
from ..messages.source import POINTS
from ..model import msgtypes as types
from .guess_pose import vehicle_frame
from .named_frames import NamedFrames
from .plan import ScanPlan
from .report import pass_over

if TYPE_CHECKING:
    from .survey import Survey
    from .topic_survey import TopicSurvey

_LIDAR = re.compile(r'velo|lidar|laser|ouster|hesai|rslidar|livox|points_raw', re.IGNORECASE)


_AHEAD = 0.7  # the cosine of 45 degrees


def guess_scan(survey: Survey, notes: list[str]) -> ScanPlan | None:
    """Choose the lidar: KITTI's own points, by name, with intensity, with most points."""
    clouds = [each for each in survey.of_type(types.CLOUD) if _with_points(each)]
    if not clouds:
        notes.append('missing: scans (no PointCloud2 with x, y and z)')
        return None
    best = max(clouds, key=_lidar_rank)
    notes += pass_over('scans', best, clouds)
    fixed = frame_on_vehicle(best.frame, survey)
    if fixed != best.frame:
        notes.append(
            f'{best.name} is in {best.frame}, in which the vehicle moves; its points are brought'
            f' to {fixed} by the poses at their stamps'
        )
        return ScanPlan(best.name, fixed, guess_intensity_scale(best.looks))
    return ScanPlan(best.name, best.frame, guess_intensity_scale(best.looks))


def frame_on_vehicle(frame: str, survey: Survey) -> str:
    """Return the frame for scans: their own, or one of the vehicle if theirs is map or odom.

    A lidar's frame that looks ahead is preferred, then the vehicle's.
    """
    names = NamedFrames(survey)
    body = vehicle_frame(survey, names)
    if not body or frame not in names.line_above(body) or not names.moving_between(frame, body):
        return frame
    for other in sorted(names.tree.frames):
        body_t_other = names.tree.find(body, other)
        if body_t_other is not None and _LIDAR.search(other):
            forward, _, up = body_t_other.rotation.T
            if forward[0] > _AHEAD and up[2] > _AHEAD:
                return other
    return body


def _with_points(topic: TopicSurvey) -> Any:  # noqa: ANN401 - of the bag's types
    """Return the first sampled message with x, y and z, None where none has them."""
    for look in topic.looks:
        if {'x', 'y', 'z'} <= {field.name for field in look.fields}:
            return look
    return None


def _lidar_rank(topic: TopicSurvey) -> tuple[bool, bool, bool, int, int]:
    first = _with_points(topic)
    named = bool(_LIDAR.search(topic.name) or _LIDAR.search(topic.frame))
    bright = any(field.name == 'intensity' for field in first.fields)
    return topic.name == POINTS, named, bright, first.width * first.height, topic.count
