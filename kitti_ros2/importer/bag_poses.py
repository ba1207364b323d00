# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The vehicle's poses of a bag: their topic, the frames that they join, moving links, the track."""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..bags.reader import Decoder, open_messages
from ..messages.cdr import stamp_ns_of
from ..messages.detections import frames_in
from ..messages.moving_tree import (
    MovingTree,
    NearestTrack,
    PoseTrack,
    ProductTrack,
    TransformSeries,
)
from ..messages.naming import LABEL_LINES
from ..messages.oxts import poses_of, poses_of_link, read_transforms
from ..messages.tf_tree import FIXED_FRAMES, find_body, plain
from ..messages.topics import own_topics
from ..model import bag_formats as types
from ..model.errors import UsageError, did_you_mean
from ..model.geometry import Transform
from ..model.samples import nearest_stamps
from ..model.streams import EARTH_RADIUS_M, NS_PER_S, Stream
from .plan import POSES, Incomplete, PosePlan
from .survey import SOLID, topic_of, unchosen_notes
from .tf_frames import NamedFrames, child_of, frame_of, is_renamed, is_truth

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    import numpy.typing as npt

    from ..bags.bag_files import BagSource
    from ..messages.moving_tree import Track
    from ..model.errors import LossTally
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array
    from .plan import Plan
    from .survey import Survey, TopicSurvey
    from .tf_frames import OdometryLink


# Choice of the topic of the vehicle's poses, and of the frames they join.

BODIES = ('base_link', 'base_footprint')
_SHORT = 2
_GLOBAL = tuple(frame_id for frame_id in FIXED_FRAMES if frame_id != 'odom')
"""The frames above odom: poses in map do not drift."""
_FIXED = (*FIXED_FRAMES, 'vision')


def guess_pose(survey: Survey, notes: list[str]) -> PosePlan | None:
    """Choose poses: Odometry, PoseStamped, Path, then transforms; ground truth first.

    A chain of transforms up to map beats poses in odom.
    """
    names = NamedFrames(survey)
    pose = _of_topics(survey, notes)
    if pose is not None and (is_truth(pose.topic) or pose.topic in own_topics()):
        return pose
    chain = _chain(survey, names, pose)
    if chain is not None:
        line = ' -> '.join(_line(names, chain))
        over = '' if pose is None else f'; poses in {pose.world} would drift'
        if pose is not None or len(_line(names, chain)) > _SHORT:
            notes.append(f'poses: {line} of {chain.topic}{over}')
        if pose is not None and pose.topic != chain.topic:
            notes.append(f'passed over for poses: {pose.topic}')
        return chain
    if pose is not None:
        notes += [
            f'passed over for poses: {link.name}, which joins {pose.world} to {pose.body}, too'
            for link in moving_transforms(survey)
            if (pose.world, pose.body) in survey.moving
        ]
    pose = pose or _link(survey) or _link_to_world(survey)
    if pose is None:
        notes.append('missing: poses (no Odometry, PoseStamped, Path or moving base_link)')
    return pose


def moving_transforms(survey: Survey) -> list[TopicSurvey]:
    """Return the topics of transforms that may move."""
    return [topic for topic in survey.of_type(*types.TF_TYPES) if 'static' not in topic.name]


def _of_topics(survey: Survey, notes: list[str]) -> PosePlan | None:
    """Choose an Odometry, PoseStamped or Path."""
    frame_ids = survey.tree.frames
    for msgtype in POSES.msgtypes:
        topics = survey.of_type(msgtype)
        if topics:
            best = max(topics, key=lambda topic: _rank(topic, frame_ids))
            if best.name not in own_topics():
                topics = survey.of_type(*POSES.msgtypes)
            notes += unchosen_notes('poses', best, topics)
            body = child_of(best)
            if best.name in own_topics():  # of base_link, also if its tree names it otherwise
                body = ''
            interpolate = not _are_of_frames(best.name)
            return PosePlan(
                best.name, body or _body(survey), best.frame_id, interpolate=interpolate
            )
    return None


def _are_of_frames(topic: str) -> bool:
    """Return whether poses are those of KITTI's frames by number, of which some may have none."""
    row = own_topics().get(topic)
    return row is not None and row.stream is Stream.POSE


def _rank(topic: TopicSurvey, frame_ids: Collection[str]) -> tuple[bool, bool, bool, int]:
    """Rank: of a body in the tree, called ground truth, that moves, of most messages."""
    return child_of(topic) in frame_ids, is_truth(topic.name), _moves(topic), topic.count


def _moves(topic: TopicSurvey) -> bool:
    """Return whether the sampled poses of a topic have several positions."""
    positions = set()
    for message in topic.samples:
        for stamped in getattr(message, 'poses', [message])[-1:]:
            pose = stamped.pose  # a PoseWithCovariance, or a Pose
            position = getattr(pose, 'pose', pose).position
            positions.add((round(position.x, 2), round(position.y, 2), round(position.z, 2)))
    return len(positions) > 1


def _chain(survey: Survey, names: NamedFrames, pose: PosePlan | None) -> PosePlan | None:
    """Return the chain of transforms up to map, or the one that replaces missing poses.

    None where the topic's poses are as good.
    """
    tf = moving_transforms(survey)
    body = _moving_body(survey, names, pose)
    if not body or (pose is None and not tf):
        return None
    line = names.line_above(body)
    moving = names.moving_between(line[-1], body)
    if not moving:
        return None
    above = line[line.index(moving[-1][0]) :]  # moving links are in order from the top
    world = next((frame_id for frame_id in _GLOBAL if frame_id in above), above[-1])
    if pose is None:
        return PosePlan(tf[0].name, body, world)
    if pose.world == world or world not in _GLOBAL:
        return None
    if pose.world in above and not names.moving_between(world, pose.world):
        return None  # a static link lies between them
    by_transforms = tf and not any(
        (link.frame, link.root) in (names.moving_between(world, body) or ())
        for link in names.odometry
    )
    return PosePlan(tf[0].name if by_transforms else pose.topic, body, world)


def _link(survey: Survey) -> PosePlan | None:
    """Return the poses of a single moving link, of a body that has several parents in the tree."""
    tf = moving_transforms(survey)
    links = [link for link in survey.moving if link[1] in BODIES]
    if not tf or not links:
        return None
    parent, child = next((link for link in links if link[0] in _GLOBAL), links[0])
    return PosePlan(tf[0].name, child, parent)


def _link_to_world(survey: Survey) -> PosePlan | None:
    """Return the poses of a body that is the parent of its fixed frame, as Spot's driver has it."""
    tf = moving_transforms(survey)
    links = [link for link in survey.moving if link[1] in _FIXED]
    if not tf or not links:
        return None
    body, world = min(links, key=lambda link: _FIXED.index(link[1]))
    return PosePlan(tf[0].name, body, world)


def _moving_body(survey: Survey, names: NamedFrames, pose: PosePlan | None) -> str:
    """Return the frame of the vehicle in the tree, empty for none."""
    if pose is not None:
        return pose.body if pose.body in names.tree.frames else ''
    for body in BODIES:
        if body in names.tree.frames and len(names.line_above(body)) > 1:
            return body
    return _carrier(survey, names)


def _carrier(survey: Survey, names: NamedFrames) -> str:
    """Return the frame below the lowest moving link above a lidar or a camera, empty for none."""
    for topic in survey.of_type(types.CLOUD, types.IMAGE, types.COMPRESSED):
        line = names.line_above(topic.frame_id) if topic.frame_id in names.tree.frames else []
        moving = names.moving_between(line[-1], topic.frame_id) if line else None
        if moving:
            return moving[-1][1]  # links are in order from the top
    return ''


def _line(names: NamedFrames, chain: PosePlan) -> list[str]:
    """Return the frames from the world to the body of a chain."""
    line = names.line_above(chain.body)
    return line[: line.index(chain.world) + 1][::-1]


def vehicle_frame(survey: Survey, names: NamedFrames) -> str:
    """Return the frame of the vehicle, empty if unknown."""
    pose = _of_topics(survey, [])
    return _moving_body(survey, names, pose)


def _body(survey: Survey) -> str:
    frame_ids = {name for parent, child, _ in survey.static for name in (parent, child)}
    named = next((name for name in BODIES if name in frame_ids), '')
    heading = None if named else find_body(survey.tree, frame_ids)
    return named or (BODIES[0] if heading is None else heading.frame)


# The moving links of bags, read in a pass of its own over the topics that a plan needs.

_FARTHEST_M = 1e9
_INVALID = 'a transform of NaN, of an impossible place or of an orientation of all zeros'


class StampedSeries:
    """Transforms with their stamps, in the order of reading."""

    def __init__(self) -> None:
        self._stamps = array('q')
        self._series = TransformSeries()

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, numbers: Sequence[float]) -> None:
        """Append x y z, metres, and x y z w of a quaternion.

        Raises:
            ValueError: It is not a transform.
        """
        norm = math.hypot(*numbers[3:])
        # Comparisons with NaN are false.
        if not (max(map(abs, numbers[:3])) <= _FARTHEST_M and 0 < norm < math.inf) or any(
            map(math.isnan, numbers[:3])
        ):
            raise ValueError(_INVALID)
        self._stamps.append(stamp_ns)
        self._series.append(numbers)

    def clear(self) -> None:
        """Remove all."""
        self._stamps, self._series = array('q'), TransformSeries()

    def track(self, stamps_ns: Sequence[int] | None = None, offset_ns: int = 0) -> PoseTrack:
        """Return them as a track.

        Args:
            stamps_ns: Instead of their own.
            offset_ns: Added to the stamps.
        """
        own = np.array(self._stamps if stamps_ns is None else stamps_ns, dtype=np.int64)
        return PoseTrack(own + offset_ns, self._series)


def numbers_of(position: Any, q: Any) -> tuple[float, ...]:  # noqa: ANN401 - of a bag's types
    """Return x y z of a Point or Vector3, and x y z w of a Quaternion."""
    return (position.x, position.y, position.z, q.x, q.y, q.z, q.w)


class LinkTracks:
    """Collects the transforms of moving links from the TFMessages of a bag.

    Args:
        links: (parent, child) of those to keep; None keeps all.
    """

    def __init__(self, links: Collection[tuple[str, str]] | None = None) -> None:
        self._links = None if links is None else frozenset(links)
        self._series: dict[tuple[str, str], StampedSeries] = defaultdict(StampedSeries)

    def add(
        self,
        data: bytes | memoryview,
        log_ns: int,
        *,
        by_log: bool = False,
        offset_ns: int = 0,
    ) -> None:
        """Add the transforms of a serialised TFMessage; those with stamp 0 get the log time.

        Args:
            data: The message.
            log_ns: When it was recorded.
            by_log: Whether all transforms get the log time.
            offset_ns: Added to the stamps.

        Raises:
            ValueError: It is truncated, or some are not transforms; the others were added.
        """
        fault: ValueError | None = None
        for stamp_ns, parent, child, numbers in read_transforms(data):
            link = plain(parent), plain(child)
            if self._links is not None and link not in self._links:
                continue
            try:
                own_ns = log_ns if by_log else stamp_ns or log_ns
                self._series[link].add(own_ns + offset_ns, numbers)
            except ValueError as error:
                fault = error
        if fault is not None:
            raise fault

    def tracks(self) -> dict[tuple[str, str], PoseTrack]:
        """Return the poses of each link over time."""
        return {link: series.track() for link, series in self._series.items()}


def links_between(names: NamedFrames, pairs: Sequence[tuple[str, str]]) -> frozenset[OdometryLink]:
    """Return the Odometry, and PoseStamped, on the ways between pairs of frames."""
    moving_links = {link for pair in pairs for link in names.moving_between(*pair) or ()}
    return frozenset(link for link in names.odometry if (link.frame, link.root) in moving_links)


def read_tree(
    bags: Sequence[BagSource],
    survey: Survey,
    names: NamedFrames,
    pairs: Sequence[tuple[str, str]],
    losses: LossTally,
    reported_topic: str = '',
) -> MovingTree:
    """Read the moving links between pairs of frames, in one pass over their topics.

    Args:
        bags: Parts of a recording.
        survey: The survey of the bags.
        names: Its links.
        pairs: Target and source frame of each; those that nothing joins are skipped.
        losses: Takes messages without a valid transform.
        reported_topic: A topic whose invalid messages are entered elsewhere.

    Raises:
        BadBagError: A bag cannot be read.
    """
    needed = {link for pair in pairs for link in names.moving_between(*pair) or ()}
    used = links_between(names, pairs)
    # The way from an Odometry's child to the root of its tree may move, too.
    needed |= {link for odom in used for link in names.moving_between(odom.child, odom.root) or ()}
    tf_topics = {moving_transform.name for moving_transform in moving_transforms(survey)}
    links = LinkTracks(needed)
    poses = {odom.topic: StampedSeries() for odom in used}
    with open_messages(bags, tf_topics | set(poses)) as messages:
        decode = Decoder(messages.typestore)
        for message in messages:
            try:
                topic = survey.topics[message.topic]
                if message.topic in poses:
                    decoded = decode(message)
                    pose = getattr(decoded.pose, 'pose', decoded.pose)
                    stamp_ns = 0 if topic.by_log else stamp_ns_of(decoded.header)
                    own_ns = (stamp_ns or message.stamp_ns) + topic.offset_ns
                    poses[message.topic].add(own_ns, numbers_of(pose.position, pose.orientation))
                else:
                    links.add(
                        message.data,
                        message.stamp_ns,
                        by_log=topic.by_log,
                        offset_ns=topic.offset_ns,
                    )
            except ValueError as error:
                if message.topic != reported_topic:
                    losses.lose(message.topic, message.stamp_ns, str(error))
    tracks: dict[tuple[str, str], Track] = {link: PoseTrack([], []) for link in survey.moving}
    tracks.update(links.tracks())
    tree = MovingTree(survey.static, tracks)
    for odom in names.odometry:
        track: Track = poses[odom.topic].track() if odom.topic in poses else PoseTrack([], [])
        if odom.root != odom.child:
            after = tree.links.find(odom.child, odom.root) or tree.track(odom.child, odom.root)
            track = ProductTrack(Transform.identity(), track, after)
        tracks[odom.frame, odom.root] = track
        tree = MovingTree(survey.static, tracks)
    return tree


# The frames that the poses of a plan join, and those that its topic's poses are given in.
#
# They are world_T_body of the plan. A topic's own frames may be others: Odometry in odom of
# base_footprint becomes that of base_link in map by the transforms at the same stamps.

_SHOWN = 12


class PoseEnds(NamedTuple):
    """Frames of poses; frame and moved are equal where transforms are the whole way.

    Attributes:
        world: The frame in which the plan has its poses.
        frame: The frame in which the topic has them.
        moved: The frame whose poses the topic has.
        body: The frame whose poses the plan has.
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


def moving_pairs(plan: Plan, survey: Survey, names: NamedFrames) -> list[tuple[str, str]]:
    """Return the pairs of frames that moving links join, and that scans and labels need.

    Raises:
        UsageError: The plan names a missing topic.
    """
    pairs = []
    base = _base_frame(plan, survey)
    if plan.scan is not None:
        clouds = topic_of(survey, plan.scan.topic)
        pairs += [(plan.scan.frame, other) for other in clouds.frame_ids]
    if plan.labels is not None and plan.labels.topic != LABEL_LINES and base:
        pairs += [(base, other) for other in sorted(_frames_of_boxes(plan.labels.topic, survey))]
    return [pair for pair in pairs if names.moving_between(*pair)]


def _base_frame(plan: Plan, survey: Survey) -> str:
    """Return the frame that boxes are brought to: the scans', else that of the first camera."""
    if plan.scan is not None:
        return plan.scan.frame
    with_info = sorted(index for index, camera in plan.cameras.items() if camera.info)
    if not with_info:
        return ''
    first = plan.cameras[with_info[0]]
    return frame_of(first, survey)


def _frames_of_boxes(name: str, survey: Survey) -> set[str]:
    topic = topic_of(survey, name)
    frame_ids = set(topic.frame_ids)
    if topic.msgtype in SOLID:
        for message in topic.samples:
            frame_ids |= frames_in(message)
    return frame_ids


def needed_pairs(plan: Plan, survey: Survey, names: NamedFrames) -> list[tuple[str, str]]:
    """Return the pairs of frames that links must join for scans, labels and poses of a plan.

    Raises:
        UsageError: The plan names a missing topic, or as find_ends.
    """
    pairs = moving_pairs(plan, survey, names)
    if plan.pose is not None:
        ends = find_ends(plan.pose, topic_of(survey, plan.pose.topic), survey, names)
        pairs += ends.pairs()
    return pairs


def link_topics(plan: Plan, survey: Survey) -> set[str]:
    """Return the topics whose poses a plan uses as links between frames.

    Raises:
        UsageError: The plan names a missing topic.
    """
    names = NamedFrames(survey, plan.pose)
    return {link.topic for link in links_between(names, needed_pairs(plan, survey, names))}


def find_ends(plan: PosePlan, topic: TopicSurvey, survey: Survey, names: NamedFrames) -> PoseEnds:
    """Find the frames of a plan's poses; all are empty where the topic's are used as they are.

    Raises:
        UsageError: The plan names a frame that is not in the bag, or that nothing joins.
    """
    if topic.msgtype in types.TF_TYPES:
        return _ends_of_links(plan, survey, names)
    if topic.msgtype in POSES.msgtypes and topic.name not in own_topics():
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
    frame_id, moved = topic.frame_id, child_of(topic)
    world, body = plan.world or frame_id, plan.body or moved
    if not moved or is_renamed(plan, topic, names):
        moved = body
    if (world, body) == (frame_id, moved):
        return _AS_THEY_ARE
    _check_frames(plan, names, moved)
    _check_joined(world, frame_id, names)
    _check_joined(moved, body, names)
    return PoseEnds(world, frame_id, moved, body)


def _check_frames(plan: PosePlan, names: NamedFrames, child: str) -> None:
    frame_ids = names.tree.frames | ({child} if child else set())
    for key, name in (('world', plan.world), ('body', plan.body)):
        if name and plain(name) not in frame_ids:
            shown = ', '.join(sorted(frame_ids)[:_SHOWN]) or 'no frames'
            raise UsageError(
                f'the plan has pose: {key}: {name}, which is no frame of the bag; expected one of'
                f' {shown}{did_you_mean(name, sorted(frame_ids))}'
            )


def _check_joined(target: str, source: str, names: NamedFrames) -> None:
    if target != source and names.moving_between(target, source) is None:
        raise UsageError(
            f'the plan has poses of {source} in {target}, which no transforms join; the bag has'
            f' {names.tree}: name frames of one tree in pose: world and pose: body'
        )


# Velocities of a vehicle from its positions over time, where no message of a bag has any.
#
# A parabola is fitted to the positions near each stamp, so that a steady acceleration is met, also
# at the ends. A movement within the scatter of the positions is none: a standing vehicle has the
# velocity 0.

SLOWEST_FIX_M_S = 0.2
"""Positions of a standing receiver wander by some 0.1 m a second."""
SLOWEST_POSE_M_S = 0.02

_WINDOW_NS = NS_PER_S // 2
_WINDOW_PERIODS = 1.5
_WIDENINGS = (1, 2, 4)
_SIGMAS = 5.0
_CLEAR_M_S = 0.5
"""Scatter above this hides a slow vehicle; a wider window shows it."""
_GLITCH, _GLITCH_M = 10.0, 2.0  # of the usual distance, and metres more
_PARABOLA = 2
_DIFFERENCES = 3
_EVEN = 1.2
_GROWTH = np.sqrt(20)  # of a standard deviation in third differences: 1, 3, 3, 1
_SIGMA_OF_MEDIAN = 1.4826  # of a normal distribution, by the median of absolute values


def metres_of(fixes: Float64Array) -> Float64Array:
    """Return (N, 3) metres east, north, up of the first of (N, 3) positions, on KITTI's sphere.

    Args:
        fixes: Latitude and longitude in degrees, altitude in metres, of which some may be NaN.
    """
    if not len(fixes):
        return np.zeros((0, 3))
    lat, lon, alt = fixes.T
    radius_m = EARTH_RADIUS_M * np.cos(np.radians(lat))
    east = np.radians(np.unwrap(lon, period=360.0) - lon[0]) * radius_m
    north = np.radians(lat - lat[0]) * EARTH_RADIUS_M
    return np.column_stack([east, north, np.nan_to_num(alt - np.nanmin(alt, initial=1e9))])


class DerivedVelocities:
    """The velocities of a vehicle by its positions, each computed when it is requested.

    Args:
        stamps_ns: (N,) of the positions, ascending.
        positions: (N, 3) metres.
        most_ns: A longer gap between two positions is not bridged; a stamp farther from any
            position has no velocity.
        slowest: Slower than this, m/s, the vehicle stands.
    """

    def __init__(
        self, stamps_ns: Int64Array, positions: Float64Array, most_ns: int, slowest: float
    ) -> None:
        regular = ~_glitches(stamps_ns, positions)
        stamps_ns, positions = stamps_ns[regular], positions[regular]
        self._stamps_ns = stamps_ns
        self._positions = positions
        self._most_ns = most_ns
        self._slowest = slowest
        steps = np.diff(stamps_ns)
        self._scatter = _scatter_of(positions, steps)
        usual = float(np.median(steps)) if len(steps) else 0.0
        self._window_ns = max(_WINDOW_NS, round(_WINDOW_PERIODS * usual))
        self._starts = np.flatnonzero(np.concatenate([[True], steps > most_ns]))

    def at(self, at_ns: int) -> Float64Array | None:
        """Return (3,) m/s along the axes of the positions at a stamp, None where unknown."""
        stamps = self._stamps_ns
        if len(stamps) < _PARABOLA:
            return None
        nearest, later_ns = nearest_stamps(stamps, np.array([at_ns]))
        run = int(np.searchsorted(self._starts, nearest[0], 'right'))
        begin = int(self._starts[run - 1])
        end = int(self._starts[run]) if run < len(self._starts) else len(stamps)
        if end - begin < _PARABOLA or abs(int(later_ns[0])) > self._most_ns:
            return None
        seconds = (stamps[begin:end] - at_ns) / NS_PER_S
        for times in _WIDENINGS:
            first, last = _near(seconds, times * self._window_ns / NS_PER_S)
            positions = self._positions[begin + first : begin + last]
            velocity, blur = _slope(seconds[first:last], positions, self._scatter)
            if np.hypot(*velocity[:2]) > max(self._slowest, blur):
                return velocity
            if blur <= _CLEAR_M_S:
                break
        return np.zeros(3)


def _glitches(stamps_ns: Int64Array, positions: Float64Array) -> npt.NDArray[np.bool_]:
    """Return (N,) which single positions are far off the way between their neighbours."""
    aside = np.zeros(len(positions))
    if len(positions) <= _DIFFERENCES:
        return aside > 0
    ground = positions[:, :2]
    share = (np.diff(stamps_ns)[:-1] / np.maximum(stamps_ns[2:] - stamps_ns[:-2], 1))[:, None]
    way = ground[:-2] + share * (ground[2:] - ground[:-2])
    aside[1:-1] = np.linalg.norm(ground[1:-1] - way, axis=1)
    most = np.lib.stride_tricks.sliding_window_view(np.pad(aside, 1), _DIFFERENCES).max(axis=1)
    limit = _GLITCH_M + _GLITCH * float(np.median(aside))
    far: npt.NDArray[np.bool_] = (aside > limit) & (aside == most)
    return far


def _near(seconds: Float64Array, window: float) -> tuple[int, int]:
    """Return the first, and the end, of the times around 0 s; at least two."""
    first, last = np.searchsorted(seconds, [-window, window + 1e-9]).tolist()
    if last - first < _PARABOLA:
        first = max(min(first - 1, len(seconds) - _PARABOLA), 0)
        last = first + _PARABOLA
    return first, last


def _scatter_of(positions: Float64Array, steps: Int64Array) -> float:
    """Return the standard deviation of positions on the ground about their course, metres.

    Third differences of evenly spaced positions are free of a steady acceleration; others are not.
    """
    if len(steps) < _DIFFERENCES:
        return 0.0
    around = np.lib.stride_tricks.sliding_window_view(steps, _DIFFERENCES)
    even = around.max(axis=1) <= _EVEN * around.min(axis=1)
    jumps = np.abs(np.diff(positions[:, :2], _DIFFERENCES, axis=0))[even]
    return float(_SIGMA_OF_MEDIAN * np.median(jumps) / _GROWTH) if jumps.size else 0.0


def _slope(
    seconds: Float64Array, positions: Float64Array, known_scatter: float
) -> tuple[Float64Array, float]:
    """Return (3,) the velocity at 0 s, and the speed up to which it is scatter of the positions."""
    degree = min(_PARABOLA, len(seconds) - 1)
    powers = np.vander(seconds, degree + 1, increasing=True)
    middle = positions.mean(axis=0)  # maps may be far from their origin
    inverse = np.linalg.pinv(powers)
    parts = inverse @ (positions - middle)
    rest = positions - middle - powers @ parts
    freedom = 2 * max(len(seconds) - degree - 1, 1)
    scatter = max(known_scatter, float(np.sqrt((rest[:, :2] ** 2).sum() / freedom)))
    return parts[1], _SIGMAS * scatter * float(np.linalg.norm(inverse[1]))


# The poses of a plan, from Odometry, PoseStamped, Path or TFMessage, and the links to its frames.
#
# They are world_T_body of the plan. A topic's own frames may be others: Odometry in odom of
# base_footprint becomes that of base_link in map by the transforms at the same stamps.


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """The movements that a plan needs.

    Attributes:
        track: The poses of the plan, None without any.
        tree: The links between frames over time, None where all that are needed stand still.
        of_frames: The track, where frames without a pose are to be dropped.
        notes: Notes.
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
    pairs = needed_pairs(plan, survey, names)
    reported_topic = '' if plan.pose is None else _reported_topic(topic_of(survey, plan.pose.topic))
    tree = read_tree(bags, survey, names, pairs, losses, reported_topic) if pairs else None
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
    if not plan.pose.interpolate:
        track = NearestTrack(track, round(plan.tolerance_s * NS_PER_S))
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
        survey: The survey of the bags.
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
        tree = read_tree(bags, survey, names, pairs, losses, _reported_topic(topic))
    world, frame_id, moved, body = ends
    if tree is not None and frame_id == moved and world != body:
        pose_track: Track = tree.track(world, body)
        if not len(pose_track):
            raise NoPosesError(f'{topic.name}: holds no pose of {body} in {world}')
        return pose_track
    pose_track = _read(bags, plan, topic, survey, losses, child)
    if tree is None or not pairs:
        return pose_track
    before: Track | Transform = Transform.identity()
    after: Track | Transform = Transform.identity()
    if world != frame_id:
        before = tree.links.find(world, frame_id) or tree.track(world, frame_id)
    if moved != body:
        after = tree.links.find(moved, body) or tree.track(moved, body)
    return ProductTrack(before, pose_track, after)


def _reported_topic(topic: TopicSurvey) -> str:
    """Return the topic if its invalid poses are found when the track is read."""
    return topic.name if topic.msgtype in POSES.msgtypes else ''


def _read(
    bags: Sequence[BagSource],
    plan: PosePlan,
    topic: TopicSurvey,
    survey: Survey,
    losses: LossTally,
    child: str,
) -> Track:
    """Read the poses of a topic, or of the one link of a TFMessage, as they are."""
    series = StampedSeries()
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
                series.clear()  # each path repeats the earlier poses: the last one has all
            for pose in poses:
                series.add(*pose)
    if not len(series):
        whose = f' of {plan.body}' if plan.body else ''
        raise NoPosesError(f'{topic.name}: holds no pose{whose}{reason}')
    if topic.msgtype in (types.ODOMETRY, types.POSE) and len(series) == topic.count:
        return series.track(topic.stamps()[0].tolist())
    return series.track(offset_ns=topic.offset_ns)


def _check_child(child_frame: str, expected: str) -> None:
    if child_frame != expected:
        raise ValueError(f'of {child_frame or "no frame"}, not of {expected}')


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
    if msgtype in POSES.msgtypes:
        poses_of(message)
        stamped = getattr(message, 'poses', [message])
        poses = [(pose.header, getattr(pose.pose, 'pose', pose.pose)) for pose in stamped]
        return [
            (stamp_ns_of(header), numbers_of(pose.position, pose.orientation))
            for header, pose in poses
        ]
    if msgtype not in types.TF_TYPES:
        raise UsageError(
            f'{plan.topic} is a {msgtype}; poses come from Odometry, PoseStamped, Path or TFMessage'
        )
    links = [link for link in survey.moving if link[1] == plan.body]
    plan_links = [link for link in links if link[0] == plan.world] or links
    if not plan_links:
        return []
    poses_of_link(message, plan_links[0])
    return [
        (
            stamp_ns_of(transform.header) or log_ns,
            numbers_of(transform.transform.translation, transform.transform.rotation),
        )
        for transform in message.transforms
        if (plain(transform.header.frame_id), plain(transform.child_frame_id)) == plan_links[0]
    ]
