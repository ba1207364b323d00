# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the scans' topic; scan_frame chooses the frame that becomes KITTI's."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from ..messages.clouds import guess_intensity_scale
from ..messages.source import POINTS
from ..model import msgtypes as types
from .plan import ScanPlan
from .report import pass_over

if TYPE_CHECKING:
    from .survey import Survey
    from .topic_survey import TopicSurvey

_LIDAR = re.compile(r'velo|lidar|laser|ouster|hesai|rslidar|livox|points_raw', re.IGNORECASE)


def guess_scan(survey: Survey, notes: list[str]) -> ScanPlan | None:
    """Choose the lidar: KITTI's own points, by name, with intensity, with most points."""
    clouds = [each for each in survey.of_type(types.CLOUD) if _with_points(each)]
    if not clouds:
        notes.append('missing: scans (no PointCloud2 with x, y and z)')
        return None
    best = max(clouds, key=_lidar_rank)
    notes += pass_over('scans', best, clouds)
    return ScanPlan(best.name, best.frame, guess_intensity_scale(best.looks))


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
