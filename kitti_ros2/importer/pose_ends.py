# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames that the poses of a plan join, and those that its topic's poses are given in.

They are world_T_body of the plan. A topic's own frames may be others: Odometry in odom of
base_footprint becomes that of base_link in map by the transforms at the same stamps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ..messages.topics import own_topics
from ..model import msgtypes as types
from ..model.errors import UsageError
from ..model.spelling import did_you_mean
from ..rig.tf_tree import plain
from .motion import links_between
from .named_frames import NamedFrames, child_of, is_renamed, moving_pairs
from .planned_topics import topic_of

if TYPE_CHECKING:
    from .plan import Plan, PosePlan
    from .survey import Survey
    from .topic_survey import TopicSurvey

POSE_TYPES = (types.ODOMETRY, types.POSE, types.PATH)
"""Message types of poses, besides transforms."""

_SHOWN = 12


class PoseEnds(NamedTuple):
    """Frames of poses; frame and moved are equal where transforms are the whole way.

    Attributes:
        world: In which the plan has its poses.
        frame: In which the topic has them.
        moved: Of which the topic has them.
        body: Of which the plan has them.
    """

    world: str
    frame: str
    moved: str
    body: str

    def pairs(self) -> list[tuple[str, str]]:
        """Return the pairs of frames that transforms must join."""
        if self.frame == self.moved:
            whole = self.world, self.body
            return [whole] if self.world != self.body else []
        ways = (self.world, self.frame), (self.moved, self.body)
        return [way for way in ways if way[0] != way[1]]


_AS_THEY_ARE = PoseEnds('', '', '', '')


def pose_pairs(plan: PosePlan | None, survey: Survey, names: NamedFrames) -> list[tuple[str, str]]:
    """Return the pairs of frames that transforms must join for the poses of a plan.

    Raises:
        UsageError: As find_ends.
    """
    if plan is None:
        return []
    return find_ends(plan, topic_of(survey, plan.topic), survey, names).pairs()


def link_topics(plan: Plan, survey: Survey) -> set[str]:
    """Return the topics whose poses a plan uses as links between frames.

    Raises:
        UsageError: The plan names a missing topic.
    """
    names = NamedFrames(survey, plan.pose)
    pairs = [*moving_pairs(plan, survey, names), *pose_pairs(plan.pose, survey, names)]
    return {each.topic for each in links_between(names, pairs)}


def find_ends(plan: PosePlan, topic: TopicSurvey, survey: Survey, names: NamedFrames) -> PoseEnds:
    """Find the frames of a plan's poses; all are empty where the topic's are used as they are.

    Raises:
        UsageError: The plan names a frame that is not in the bag, or that nothing joins.
    """
    if topic.msgtype in types.TF_TYPES:
        return _ends_of_links(plan, survey, names)
    if topic.msgtype in POSE_TYPES and topic.name not in own_topics():
        return _ends_of_poses(plan, topic, names)
    return _AS_THEY_ARE


def _ends_of_links(plan: PosePlan, survey: Survey, names: NamedFrames) -> PoseEnds:
    links = [link for link in survey.moving if link[1] == plan.body]
    world = plan.world or (links[0][0] if links else '')
    if not world and plan.body in names.tree.frames:
        world = names.tree.root_of(plan.body)
    if (world, plan.body) in links:
        return _AS_THEY_ARE
    _check_frames(plan, names, '')
    _check_joined(world, plan.body, names)
    return PoseEnds(world, plan.body, plan.body, plan.body)


def _ends_of_poses(plan: PosePlan, topic: TopicSurvey, names: NamedFrames) -> PoseEnds:
    frame, moved = topic.frame, child_of(topic)
    world, body = plan.world or frame, plan.body or moved
    if not moved or is_renamed(plan, topic, names):
        moved = body
    if (world, body) == (frame, moved):
        return _AS_THEY_ARE
    _check_frames(plan, names, moved)
    _check_joined(world, frame, names)
    _check_joined(moved, body, names)
    return PoseEnds(world, frame, moved, body)


def _check_frames(plan: PosePlan, names: NamedFrames, child: str) -> None:
    known = names.tree.frames | ({child} if child else set())
    for key, name in (('world', plan.world), ('body', plan.body)):
        if name and plain(name) not in known:
            shown = ', '.join(sorted(known)[:_SHOWN]) or 'no frames'
            raise UsageError(
                f'the plan has pose: {key}: {name}, which is no frame of the bag; expected one of'
                f' {shown}{did_you_mean(name, sorted(known))}'
            )


def _check_joined(target: str, source: str, names: NamedFrames) -> None:
    if target != source and names.moving_between(target, source) is None:
        raise UsageError(
            f'the plan has poses of {source} in {target}, which no transforms join; the bag has'
            f' {names.tree}: name frames of one tree in pose: world and pose: body'
        )
