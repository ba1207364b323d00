# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a plan, from Odometry, PoseStamped, Path or TFMessage."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..messages.header import stamp_ns_of, transform_of
from ..messages.ros_types import TFMessage
from ..messages.transforms import decode_static
from ..model.errors import UsageError
from . import survey as types
from .frames import topic_of
from .pose_track import PoseTrack

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from ..bags.reader import BagSource
    from ..messages.ros_types import Odometry, Path, PoseStamped
    from ..model.geometry import Transform
    from .plan import PosePlan
    from .report import LossTally
    from .survey import Survey

_FARTHEST_M = 1e9


class StampedPose(NamedTuple):
    """A pose in a message: its stamp, nanoseconds, and parent_T_child."""

    stamp_ns: int
    parent_T_child: Transform


def read_track(
    bags: Sequence[BagSource], plan: PosePlan, survey: Survey, losses: LossTally
) -> PoseTrack:
    """Read the poses that a plan names.

    Raises:
        UsageError: The topic is missing, or its type has no poses.
    """
    topic = topic_of(survey, plan.topic)
    found: list[StampedPose] = []
    reason = ''
    with open_messages(bags, {topic.name}) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                poses = _poses(decode(message), message.msgtype, plan, survey)
            except ValueError as error:
                reason = reason or f' ({error})'
                losses.lose(topic.name, message.stamp_ns, f'no pose ({error})')
                continue
            if message.msgtype == types.PATH:
                found.clear()  # each path repeats the earlier poses: the last one has all
            found.extend(poses)
    stamps = [pose.stamp_ns for pose in found]
    if topic.msgtype in (types.ODOMETRY, types.POSE) and len(found) == topic.count:
        stamps = topic.stamps()[0].tolist()
    if not found:
        raise UsageError(f'{topic.name}: holds no pose of {plan.body}{reason}')
    return PoseTrack(stamps, [pose.parent_T_child for pose in found])


def _poses(message: Any, msgtype: str, plan: PosePlan, survey: Survey) -> list[StampedPose]:  # noqa: ANN401
    if msgtype in _POSES:
        return _POSES[msgtype](message)
    if msgtype in types.TF_TYPES:
        links = [link for link in survey.moving if link[1] == plan.body]
        wanted = [link for link in links if link[0] == plan.world] or links
        return poses_from_tf(message, wanted[:1])
    raise UsageError(
        f'{plan.topic} is a {msgtype}; poses come from Odometry, PoseStamped, Path or TFMessage'
    )


def poses_from_odometry(message: Odometry) -> list[StampedPose]:
    """Decode the pose of a nav_msgs/Odometry.

    Raises:
        ValueError: It is invalid: NaN, or an orientation of all zeros.
    """
    return [StampedPose(stamp_ns_of(message.header), _checked(transform_of(message.pose.pose)))]


def poses_from_pose_stamped(message: PoseStamped) -> list[StampedPose]:
    """Decode the pose of a geometry_msgs/PoseStamped.

    Raises:
        ValueError: As poses_from_odometry.
    """
    return [StampedPose(stamp_ns_of(message.header), _checked(transform_of(message.pose)))]


def poses_from_path(message: Path) -> list[StampedPose]:
    """Decode the poses of a nav_msgs/Path, each with its own stamp.

    Raises:
        ValueError: As poses_from_odometry.
    """
    return [pose for stamped in message.poses for pose in poses_from_pose_stamped(stamped)]


_POSES: dict[str, Callable[[Any], list[StampedPose]]] = {
    types.ODOMETRY: poses_from_odometry,
    types.POSE: poses_from_pose_stamped,
    types.PATH: poses_from_path,
}


def poses_from_tf(message: TFMessage, links: Collection[tuple[str, str]]) -> list[StampedPose]:
    """Decode the poses of some links (parent, child) in a tf2_msgs/TFMessage.

    The leading slash of ROS 1's frames, which tf2 does not allow, is not part of a name.

    Raises:
        ValueError: As poses_from_odometry.
    """
    wanted = [
        stamped
        for stamped in message.transforms
        if (stamped.header.frame_id.lstrip('/'), stamped.child_frame_id.lstrip('/')) in links
    ]
    decoded = decode_static(TFMessage(wanted))
    return [
        StampedPose(stamp_ns_of(stamped.header), _checked(transform))
        for stamped, (_, _, transform) in zip(wanted, decoded, strict=True)
    ]


def _checked(transform: Transform) -> Transform:
    if not (np.abs(transform.matrix()) <= _FARTHEST_M).all():
        raise ValueError('a pose of NaN, of an impossible place or of an orientation of all zeros')
    return transform
