# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The poses of a plan, from Odometry, PoseStamped, Path or TFMessage, and the links to its frames.

They are world_T_body of the plan. A topic's own frames may be others: Odometry in odom of
base_footprint becomes that of base_link in map by the transforms at the same stamps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..messages.header import stamp_ns_of
from ..messages.pose import poses_of, poses_of_link
from ..model import msgtypes as types
from ..model.errors import UsageError
from ..model.geometry import Transform
from ..model.streams import Stream
from ..rig.moving_tree import ProductTrack
from ..rig.tf_tree import plain
from .motion import StampedSeries, numbers_of, read_tree
from .named_frames import NamedFrames, child_of, is_renamed, moving_pairs
from .plan import Incomplete
from .planned_topics import topic_of
from .pose_ends import POSE_TYPES, find_ends, pose_pairs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..bags.reader import BagSource
    from ..rig.moving_tree import MovingTree
    from ..rig.pose_track import Track
    from .plan import Plan, PosePlan
    from .report import LossTally
    from .survey import Survey
    from .topic_survey import TopicSurvey


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """The movements that a plan needs.

    Attributes:
        track: The poses of the plan, None without any.
        tree: The links between frames over time, None where all that are needed stand still.
        of_frames: The track, where frames without a pose are to be dropped.
        notes: Non-fatal remarks.
    """

    track: Track | None = None
    tree: MovingTree | None = None
    of_frames: Track | None = None
    notes: tuple[str, ...] = ()


def read_motion(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, losses: LossTally
) -> PlannedMotion:
    """Read the poses of a plan, and the moving links that its scans and labels need.

    Raises:
        UsageError: As read_track.
    """
    names = NamedFrames(survey, plan.pose)
    pairs = [*moving_pairs(plan, survey, names), *pose_pairs(plan.pose, survey, names)]
    told = '' if plan.pose is None else _told(topic_of(survey, plan.pose.topic))
    tree = read_tree(bags, survey, names, pairs, losses, told) if pairs else None
    if plan.pose is None:
        return PlannedMotion(tree=tree)
    traits, notes = plan.layout.traits, list[str]()
    in_lines = Stream.OXTS in traits.line_streams and not plan.fix
    drops = (
        Stream.POSE in traits.streams
        or plan.reference == Stream.POSE.value
        or (in_lines and plan.incomplete is Incomplete.DROP)
    )
    topic = topic_of(survey, plan.pose.topic)
    if is_renamed(plan.pose, topic, names) and child_of(topic):
        notes.append(
            f'{topic.name}: its poses are of {child_of(topic)}, which no transform names; they are'
            f' taken as those of {plan.pose.body}'
        )
    try:
        track = read_track(bags, plan.pose, survey, losses, tree=tree)
    except NoPosesError as error:
        if drops:
            raise
        return PlannedMotion(tree=tree, notes=(*notes, str(error)))
    return PlannedMotion(track, tree, track if drops else None, tuple(notes))


def read_moving(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, losses: LossTally
) -> MovingTree | None:
    """Read the moving links that the scans and labels of a plan need, None if they need none.

    Raises:
        UsageError: The plan names a missing topic.
    """
    names = NamedFrames(survey, plan.pose)
    pairs = moving_pairs(plan, survey, names)
    return read_tree(bags, survey, names, pairs, losses) if pairs else None


class NoPosesError(UsageError):
    """A topic of a plan's poses holds none."""


def read_track(
    bags: Sequence[BagSource],
    plan: PosePlan,
    survey: Survey,
    losses: LossTally,
    *,
    child: str = '',
    tree: MovingTree | None = None,
) -> Track:
    """Read the poses that a plan names.

    Args:
        bags: Parts of a recording.
        plan: The topic or link.
        survey: Of the bags.
        losses: Takes messages without a valid pose.
        child: The only valid child frame of Odometry; empty for any.
        tree: The links of the bags, where they have been read for the pairs of pose_pairs.

    Raises:
        UsageError: The topic is missing, or its type has no poses, or it names frames that are not
            in the bag or that nothing joins.
    """
    topic = topic_of(survey, plan.topic)
    names = NamedFrames(survey, plan)
    ends = find_ends(plan, topic, survey, names)
    pairs = ends.pairs()
    if pairs and tree is None:
        tree = read_tree(bags, survey, names, pairs, losses, _told(topic))
    world, frame, moved, body = ends
    if tree is not None and frame == moved and world != body:
        found: Track = tree.track(world, body)
        if not len(found):
            raise NoPosesError(f'{topic.name}: holds no pose of {body} in {world}')
        return found
    found = _read(bags, plan, topic, survey, losses, child)
    if tree is None or not pairs:
        return found
    before: Track | Transform = Transform.identity()
    after: Track | Transform = Transform.identity()
    if world != frame:
        before = tree.links.find(world, frame) or tree.track(world, frame)
    if moved != body:
        after = tree.links.find(moved, body) or tree.track(moved, body)
    return ProductTrack(before, found, after)


def _told(topic: TopicSurvey) -> str:
    """Return the topic if its invalid poses are found when the track is read."""
    return topic.name if topic.msgtype in POSE_TYPES else ''


def _read(
    bags: Sequence[BagSource],
    plan: PosePlan,
    topic: TopicSurvey,
    survey: Survey,
    losses: LossTally,
    child: str,
) -> Track:
    """Read the poses of a topic, or of the one link of a TFMessage, as they are."""
    found = StampedSeries()
    reason = ''
    with open_messages(bags, {topic.name}) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                decoded = decode(message)
                if child and message.msgtype == types.ODOMETRY:
                    _check_child(decoded.child_frame_id.lstrip('/'), child)
                poses = _poses(decoded, message.msgtype, plan, survey, message.stamp_ns)
            except ValueError as error:
                reason = reason or f' ({error})'
                losses.lose(topic.name, message.stamp_ns, f'no pose ({error})')
                continue
            if message.msgtype == types.PATH:
                found.clear()  # each path repeats the earlier poses: the last one has all
            for each in poses:
                found.add(*each)
    if not len(found):
        whose = f' of {plan.body}' if plan.body else ''
        raise NoPosesError(f'{topic.name}: holds no pose{whose}{reason}')
    if topic.msgtype in (types.ODOMETRY, types.POSE) and len(found) == topic.count:
        return found.track(topic.stamps()[0].tolist())
    return found.track(offset_ns=topic.offset_ns)


def _check_child(found: str, child: str) -> None:
    if found != child:
        raise ValueError(f'of {found or "no frame"}, not of {child}')


def _poses(
    message: Any,  # noqa: ANN401 - of the bag's types
    msgtype: str,
    plan: PosePlan,
    survey: Survey,
    log_ns: int,
) -> list[tuple[int, tuple[float, ...]]]:
    """Return stamp and numbers of the poses in a message; a transform of stamp 0 has its log time.

    Raises:
        ValueError: One is not.
    """
    if msgtype in POSE_TYPES:
        poses_of(message)
        stamped = getattr(message, 'poses', [message])
        poses = [(each.header, getattr(each.pose, 'pose', each.pose)) for each in stamped]
        return [
            (stamp_ns_of(header), numbers_of(pose.position, pose.orientation))
            for header, pose in poses
        ]
    if msgtype not in types.TF_TYPES:
        raise UsageError(
            f'{plan.topic} is a {msgtype}; poses come from Odometry, PoseStamped, Path or TFMessage'
        )
    links = [link for link in survey.moving if link[1] == plan.body]
    wanted = [link for link in links if link[0] == plan.world] or links
    if not wanted:
        return []
    poses_of_link(message, wanted[0])
    return [
        (
            stamp_ns_of(each.header) or log_ns,
            numbers_of(each.transform.translation, each.transform.rotation),
        )
        for each in message.transforms
        if (plain(each.header.frame_id), plain(each.child_frame_id)) == wanted[0]
    ]
