# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topic of the vehicle's poses, and of the frames they join."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..messages.topics import own_topics
from ..model import msgtypes as types
from .guess_names import is_truth
from .plan import PosePlan
from .report import pass_over

if TYPE_CHECKING:
    from .survey import Survey

_BODIES = ('base_link', 'base_footprint')


def guess_pose(survey: Survey, notes: list[str]) -> PosePlan | None:
    """Choose poses: Odometry, PoseStamped, Path, then a moving link; ground truth first."""
    for msgtype in (types.ODOMETRY, types.POSE, types.PATH):
        topics = survey.of_type(msgtype)
        if topics:
            best = max(topics, key=lambda each: (is_truth(each.name), each.count))
            notes += pass_over('poses', best, topics)
            look = best.looks[0] if best.looks else None
            body = str(getattr(look, 'child_frame_id', '')).lstrip('/')
            if best.name in own_topics():  # of base_link, also if its tree names it otherwise
                body = ''
            return PosePlan(best.name, body or _body(survey), best.frame)
    tf = [each for each in survey.of_type(*types.TF_TYPES) if 'static' not in each.name]
    links = [link for link in survey.moving if link[1] in _BODIES]
    if tf and links:
        return PosePlan(tf[0].name, links[0][1], links[0][0])
    notes.append('missing: poses (no Odometry, PoseStamped, Path or moving base_link)')
    return None


def _body(survey: Survey) -> str:
    known = {name for parent, child, _ in survey.static for name in (parent, child)}
    return next((name for name in _BODIES if name in known), _BODIES[0])
