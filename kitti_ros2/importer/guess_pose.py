# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topic of the vehicle's poses, and of the frames they join."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..messages.topics import own_topics
from ..model import msgtypes as types
from ..rig.heading import FIXED_FRAMES, find_body
from .guess_names import is_truth
from .named_frames import NamedFrames, child_of
from .plan import PosePlan
from .report import pass_over

if TYPE_CHECKING:
    from collections.abc import Collection

    from .survey import Survey
    from .topic_survey import TopicSurvey

BODIES = ('base_link', 'base_footprint')
_SHORT = 2
_GLOBAL = tuple(frame for frame in FIXED_FRAMES if frame != 'odom')
"""The frames above odom: poses in map do not drift."""
_FIXED = (*FIXED_FRAMES, 'vision')


def guess_pose(survey: Survey, notes: list[str]) -> PosePlan | None:
    """Choose poses: Odometry, PoseStamped, Path, then transforms; ground truth first.

    A chain of transforms up to map beats poses in odom.
    """
    names = NamedFrames(survey)
    found = _of_topics(survey, notes)
    if found is not None and (is_truth(found.topic) or found.topic in own_topics()):
        return found
    chain = _chain(survey, names, found)
    if chain is not None:
        line = ' -> '.join(_line(names, chain))
        over = '' if found is None else f'; poses in {found.world} would drift'
        if found is not None or len(_line(names, chain)) > _SHORT:
            notes.append(f'poses: {line} of {chain.topic}{over}')
        if found is not None and found.topic != chain.topic:
            notes.append(f'passed over for poses: {found.topic}')
        return chain
    if found is not None:
        notes += [
            f'passed over for poses: {each.name}, which joins {found.world} to {found.body}, too'
            for each in survey.of_type(*types.TF_TYPES)
            if (found.world, found.body) in survey.moving and 'static' not in each.name
        ]
    found = found or _link(survey) or _link_to_world(survey)
    if found is None:
        notes.append('missing: poses (no Odometry, PoseStamped, Path or moving base_link)')
    return found


def _of_topics(survey: Survey, notes: list[str]) -> PosePlan | None:
    """Choose an Odometry, PoseStamped or Path."""
    known = survey.tree.frames
    for msgtype in (types.ODOMETRY, types.POSE, types.PATH):
        topics = survey.of_type(msgtype)
        if topics:
            best = max(topics, key=lambda each: _rank(each, known))
            if best.name not in own_topics():
                topics = survey.of_type(types.ODOMETRY, types.POSE, types.PATH)
            notes += pass_over('poses', best, topics)
            body = child_of(best)
            if best.name in own_topics():  # of base_link, also if its tree names it otherwise
                body = ''
            return PosePlan(best.name, body or _body(survey), best.frame)
    return None


def _rank(topic: TopicSurvey, frames: Collection[str]) -> tuple[bool, bool, bool, int]:
    """Rank: of a body in the tree, called ground truth, that moves, of most messages."""
    return child_of(topic) in frames, is_truth(topic.name), _moves(topic), topic.count


def _moves(topic: TopicSurvey) -> bool:
    """Whether the poses of a topic that were looked at have several positions."""
    found = set()
    for look in topic.looks:
        poses = [each.pose for each in look.poses[-1:]] if hasattr(look, 'poses') else [look.pose]
        for each in poses:
            place = getattr(each, 'pose', each).position  # of a PoseWithCovariance, or of a Pose
            found.add((round(place.x, 2), round(place.y, 2), round(place.z, 2)))
    return len(found) > 1


def _chain(survey: Survey, names: NamedFrames, found: PosePlan | None) -> PosePlan | None:
    """Return the chain of transforms up to map, or that takes the place of missing poses.

    None where the topic's poses are as good.
    """
    tf = [each for each in survey.of_type(*types.TF_TYPES) if 'static' not in each.name]
    body = _moving_body(survey, names, found)
    if not body or (found is None and not tf):
        return None
    line = names.line_above(body)
    moving = names.moving_between(line[-1], body)
    if not moving:
        return None
    above = line[line.index(moving[-1][0]) :]  # moving links are in order from the top
    world = next((frame for frame in _GLOBAL if frame in above), above[-1])
    if found is None:
        return PosePlan(tf[0].name, body, world)
    if found.world == world or world not in _GLOBAL:
        return None
    if found.world in above and not names.moving_between(world, found.world):
        return None  # a static link lies between them
    by_transforms = tf and not any(
        (link.frame, link.root) in (names.moving_between(world, body) or ())
        for link in names.odometry
    )
    return PosePlan(tf[0].name if by_transforms else found.topic, body, world)


def _link(survey: Survey) -> PosePlan | None:
    """Return the poses of a single moving link, of a body that has several parents in the tree."""
    tf = [each for each in survey.of_type(*types.TF_TYPES) if 'static' not in each.name]
    links = [link for link in survey.moving if link[1] in BODIES]
    if not tf or not links:
        return None
    parent, child = next((link for link in links if link[0] in _GLOBAL), links[0])
    return PosePlan(tf[0].name, child, parent)


def _link_to_world(survey: Survey) -> PosePlan | None:
    """Return the poses of a body that is the parent of its fixed frame, as Spot's driver has it."""
    tf = [each for each in survey.of_type(*types.TF_TYPES) if 'static' not in each.name]
    links = [link for link in survey.moving if link[1] in _FIXED]
    if not tf or not links:
        return None
    body, world = min(links, key=lambda link: _FIXED.index(link[1]))
    return PosePlan(tf[0].name, body, world)


def _moving_body(survey: Survey, names: NamedFrames, found: PosePlan | None) -> str:
    """Return the frame of the vehicle in the tree, empty for none."""
    if found is not None:
        return found.body if found.body in names.tree.frames else ''
    for body in BODIES:
        if body in names.tree.frames and len(names.line_above(body)) > 1:
            return body
    return _carrier(survey, names)


def _carrier(survey: Survey, names: NamedFrames) -> str:
    """Return the frame below the lowest moving link above a lidar or a camera, empty for none."""
    for topic in survey.of_type(types.CLOUD, types.IMAGE, types.COMPRESSED):
        line = names.line_above(topic.frame) if topic.frame in names.tree.frames else []
        moving = names.moving_between(line[-1], topic.frame) if line else None
        if moving:
            return moving[-1][1]  # links are in order from the top
    return ''


def _line(names: NamedFrames, chain: PosePlan) -> list[str]:
    """Return the frames from the world to the body of a chain."""
    line = names.line_above(chain.body)
    return line[: line.index(chain.world) + 1][::-1]


def vehicle_frame(survey: Survey, names: NamedFrames) -> str:
    """Return the frame that stands for the vehicle, empty if nothing tells."""
    found = _of_topics(survey, [])
    return _moving_body(survey, names, found)


def _body(survey: Survey) -> str:
    known = {name for parent, child, _ in survey.static for name in (parent, child)}
    named = next((name for name in BODIES if name in known), '')
    heading = None if named else find_body(survey.tree, known)
    return named or (BODIES[0] if heading is None else heading.frame)
