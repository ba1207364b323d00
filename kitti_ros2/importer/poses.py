# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a plan, from Odometry, PoseStamped, Path or TFMessage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..messages.pose import poses_of, poses_of_link
from ..model import msgtypes as types
from ..model.errors import UsageError
from .frames import topic_of
from .pose_track import PoseTrack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..bags.reader import BagSource
    from ..model.geometry import Transform
    from .plan import PosePlan
    from .report import LossTally
    from .survey import Survey


def read_track(
    bags: Sequence[BagSource],
    plan: PosePlan,
    survey: Survey,
    losses: LossTally,
    *,
    child: str = '',
) -> PoseTrack:
    """Read the poses that a plan names.

    Args:
        bags: Parts of a recording.
        plan: The topic or link.
        survey: Of the bags.
        losses: Takes messages without a valid pose.
        child: The only valid child frame of Odometry; empty for any.

    Raises:
        UsageError: The topic is missing, or its type has no poses.
    """
    topic = topic_of(survey, plan.topic)
    found: list[tuple[int, Transform]] = []
    reason = ''
    with open_messages(bags, {topic.name}) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message)
                if child and message.msgtype == types.ODOMETRY:
                    _check_child(decoded.child_frame_id.lstrip('/'), child)
                poses = _poses(decoded, message.msgtype, plan, survey)
            except ValueError as error:
                reason = reason or f' ({error})'
                losses.lose(topic.name, message.stamp_ns, f'no pose ({error})')
                continue
            if message.msgtype == types.PATH:
                found.clear()  # each path repeats the earlier poses: the last one has all
            found.extend(poses)
    stamps = [stamp_ns + topic.offset_ns for stamp_ns, _ in found]
    if topic.msgtype in (types.ODOMETRY, types.POSE) and len(found) == topic.count:
        stamps = topic.stamps()[0].tolist()
    if not found:
        whose = f' of {plan.body}' if plan.body else ''
        raise UsageError(f'{topic.name}: holds no pose{whose}{reason}')
    return PoseTrack(stamps, [pose for _, pose in found])


def _check_child(found: str, child: str) -> None:
    if found != child:
        raise ValueError(f'of {found or "no frame"}, not of {child}')


def _poses(
    message: Any,  # noqa: ANN401 - of the bag's types
    msgtype: str,
    plan: PosePlan,
    survey: Survey,
) -> list[tuple[int, Transform]]:
    if msgtype in (types.ODOMETRY, types.POSE, types.PATH):
        return poses_of(message)
    if msgtype in types.TF_TYPES:
        links = [link for link in survey.moving if link[1] == plan.body]
        wanted = [link for link in links if link[0] == plan.world] or links
        return poses_of_link(message, wanted[0]) if wanted else []
    raise UsageError(
        f'{plan.topic} is a {msgtype}; poses come from Odometry, PoseStamped, Path or TFMessage'
    )
