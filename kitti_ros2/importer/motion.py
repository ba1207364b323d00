# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The moving links of bags, read in a pass of its own over the topics that a plan needs."""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.decoding import Decoder
from ..bags.reader import open_messages
from ..messages.header import stamp_ns_of
from ..messages.transform_numbers import read_transforms
from ..model import msgtypes as types
from ..model.geometry import Transform
from ..rig.moving_tree import MovingTree, ProductTrack
from ..rig.pose_track import PoseTrack, TransformSeries
from ..rig.tf_tree import plain

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from ..bags.reader import BagSource
    from ..rig.pose_track import Track
    from .named_frames import NamedFrames, OdometryLink
    from .report import LossTally
    from .survey import Survey

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


def numbers_of(place: Any, turn: Any) -> tuple[float, ...]:  # noqa: ANN401 - of a bag's types
    """Return x y z of a Point or Vector3, and x y z w of a Quaternion."""
    return (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)


class LinkTracks:
    """Collects the transforms of moving links from the TFMessages of a bag.

    Args:
        wanted: (parent, child) of the links to keep; None keeps all.
    """

    def __init__(self, wanted: Collection[tuple[str, str]] | None = None) -> None:
        self._wanted = None if wanted is None else frozenset(wanted)
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
            if self._wanted is not None and link not in self._wanted:
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
    wanted = {link for pair in pairs for link in names.moving_between(*pair) or ()}
    return frozenset(each for each in names.odometry if (each.frame, each.root) in wanted)


def read_tree(
    bags: Sequence[BagSource],
    survey: Survey,
    names: NamedFrames,
    pairs: Sequence[tuple[str, str]],
    losses: LossTally,
    told: str = '',
) -> MovingTree:
    """Read the moving links between pairs of frames, in one pass over their topics.

    Args:
        bags: Parts of a recording.
        survey: Of the bags.
        names: Its links.
        pairs: Target and source frame of each; those that nothing joins are passed over.
        losses: Takes messages without a valid transform.
        told: A topic whose invalid messages are entered elsewhere.

    Raises:
        BadBagError: A bag cannot be read.
    """
    wanted = {link for pair in pairs for link in names.moving_between(*pair) or ()}
    used = links_between(names, pairs)
    # The way from an Odometry's child to the root of its tree may move, too.
    wanted |= {link for each in used for link in names.moving_between(each.child, each.root) or ()}
    tf_topics = {each.name for each in survey.of_type(*types.TF_TYPES) if 'static' not in each.name}
    links = LinkTracks(wanted)
    poses = {each.topic: StampedSeries() for each in used}
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
                if message.topic != told:
                    losses.lose(message.topic, message.stamp_ns, str(error))
    tracks: dict[tuple[str, str], Track] = {link: PoseTrack([], []) for link in survey.moving}
    tracks.update(links.tracks())
    tree = MovingTree(survey.static, tracks)
    for each in names.odometry:
        track: Track = poses[each.topic].track() if each.topic in poses else PoseTrack([], [])
        if each.root != each.child:
            after = tree.links.find(each.child, each.root) or tree.track(each.child, each.root)
            track = ProductTrack(Transform.identity(), track, after)
        tracks[each.frame, each.root] = track
        tree = MovingTree(survey.static, tracks)
    return tree
