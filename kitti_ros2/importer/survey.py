# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Survey of a bag in one pass: stamps, frames, calibration, and a few messages of each topic.

Of large messages only the header is parsed, so the pass is as fast as reading the bag.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any

from ..bags.decoding import Decoder
from ..bags.forward_stamps import ForwardStamps
from ..bags.pieces import MessageStart, size_of
from ..bags.reader import open_messages, opened
from ..messages.header import body_after_header, peek_first_stamp, peek_header, stamp_ns_of
from ..messages.oxts import has_motion, place_of
from ..messages.pixels import size_of as image_size
from ..messages.point_spans import TurnTimes, has_times
from ..messages.scan_sources import SCAN_TYPES
from ..messages.solid_boxes import boxes_in
from ..messages.source import CALIBRATION, RECORDING, decode_text
from ..model.channels import LARGE_TYPES, PICTURES
from ..model.msgtypes import (
    CAMERA_INFO,
    CLOUD,
    FIX,
    MARKERS,
    ODOMETRY,
    STRING,
    TF_TYPES,
    TWIST,
)
from ..rig.link_tally import LinkTally
from ..rig.tf_tree import FrameTree
from .survey_types import BOXES, DESCRIBING, FIRST_ONLY, HEADED, READ, SOLID
from .topic_survey import TopicSurvey

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from ..bags.pieces import StoredChannel
    from ..bags.reader import BagMessage, BagMessages, BagSource
    from ..model.boxes import Cuboid
    from ..model.geometry import Transform
    from ..model.losses import Loss
    from ..model.samples import TextFile
    from ..rig.tf_tree import Link


_LOOKS = 8
_ALL_OF_FIRST = 64
_EVERY = 16
_WITH_TWIST = frozenset({TWIST, ODOMETRY})


@dataclass(frozen=True)
class Survey:
    """The result of a pass.

    Attributes:
        topics: By name; unused types have counts only.
        static: Static transforms (parent, child, parent_T_child), including those of /tf that never
            move.
        moving: (parent, child) of the others.
        changes: The static links that were published again with another value, by (parent, child):
            all values, each with the stamp from which it is valid.
        calibrations: The calibration files in a bag written by to-bag, each with the stamp from
            which it is valid, in order.
        notes: Non-fatal remarks of the bag's reader.
        losses: Damage, and the number of messages lost by each; None: unknown.
        left_out: Topics that cannot be read.
        clashes: Links that are of several robots, each with the topics of two.
        tracklets: Of a raw drive in a bag written by to-bag: its boxes by stamp and track, whose
            occlusion and truncation no message has.
    """

    topics: Mapping[str, TopicSurvey]
    static: Sequence[Link]
    moving: Sequence[tuple[str, str]]
    changes: Mapping[tuple[str, str], Sequence[tuple[int, Transform]]] = field(default_factory=dict)
    calibrations: Sequence[tuple[int, TextFile]] = ()
    notes: Sequence[str] = ()
    losses: Mapping[str, int | None] = field(default_factory=dict)
    left_out: Sequence[tuple[StoredChannel, Loss]] = ()
    clashes: Mapping[tuple[str, str], tuple[str, str]] = field(default_factory=dict)
    tracklets: Mapping[int, Mapping[int, Cuboid]] = field(default_factory=dict)

    @cached_property
    def tree(self) -> FrameTree:
        """The tree of all links."""
        return FrameTree(self.static, self.moving)

    def tree_with(self, static: Sequence[Link], lost: str = '') -> FrameTree:
        """Return the tree of all links and more static ones.

        Args:
            static: The links that are added.
            lost: The part that may be missing, and why.
        """
        if not static and not lost:
            return self.tree
        return FrameTree([*self.static, *static], self.moving, lost)

    def of_type(self, *msgtypes: str) -> list[TopicSurvey]:
        """Return the topics of some types with messages that can be decoded, by name."""
        return [each for each in self._of_type(msgtypes) if each.is_readable]

    def unreadable(self, *msgtypes: str) -> list[TopicSurvey]:
        """Return the topics of some types without a message that can be decoded, by name."""
        return [each for each in self._of_type(msgtypes) if not each.is_readable]

    def _of_type(self, msgtypes: Sequence[str]) -> list[TopicSurvey]:
        found = [each for each in self.topics.values() if each.msgtype in msgtypes and each.count]
        return sorted(found, key=lambda each: each.name)


def look(bags: Sequence[BagSource], topics: Collection[str] | None = None) -> Survey:
    """Survey bags in one pass.

    Args:
        bags: The bags.
        topics: The topics to read; all of them by default.

    Raises:
        BadBagError: One cannot be read.
    """
    with open_messages(bags, topics) as messages:
        taken = _Pass(messages)
        messages.skim(taken.needs_start_only)
        taken.take_all(messages)
        losses = messages.losses
        notes = [text for text in messages.findings if text not in losses]
        return taken.survey(notes, losses, messages.left_out)


def glance(source: BagSource) -> Survey:
    """Survey the description of a bag's sensors, and the first message of topics of large ones.

    Raises:
        BadBagError: It cannot be read.
    """
    with opened(source) as bag:
        with open_messages(bag) as every:
            types = dict(every.channels)
            taken = _Pass(every)
            losses, left_out = every.losses, every.left_out
        wanted = {topic for topic, msgtype in types.items() if msgtype in DESCRIBING}
        if wanted:
            with open_messages(bag, wanted) as messages:
                taken.take_all(messages)
        for topic in (topic for topic, msgtype in types.items() if msgtype in FIRST_ONLY):
            with open_messages(bag, {topic}) as messages:
                taken.take_all(islice(messages, 1))
    return taken.survey((), losses, left_out)


class _Pass:
    """Collects the survey while messages are read."""

    def __init__(self, messages: BagMessages) -> None:
        self._decode = Decoder(messages.typestore)
        self._decode_lent = Decoder(messages.typestore, lent=True)
        self._bodies: dict[str, bytes] = {}
        self._contents: dict[tuple[str, bytes], Any] = {}
        self._known: dict[str, set[tuple[int, int]]] = defaultdict(set)
        self._topics = {name: TopicSurvey(name, msgtype) for name, msgtype in messages.channels}
        self._links = LinkTally()
        self._calibrations: list[tuple[int, TextFile]] = []
        self._forward = ForwardStamps()
        # Scans of to-bag are stamped facing forward.
        self._is_own = RECORDING in self._topics
        self._turns: dict[str, TurnTimes] = {}

    def take_all(self, messages: Iterable[BagMessage]) -> None:
        """Enter messages."""
        for message in messages:
            self._take(message)

    def needs_start_only(self, name: str) -> bool:
        """Whether the next message of a topic is not decoded if it is large."""
        topic = self._topics[name]
        if topic.msgtype not in READ:
            return topic.msgtype != STRING
        is_due = _is_look(topic, topic.count + 1)
        return topic.msgtype in LARGE_TYPES and not (is_due or name in self._turns)

    def survey(
        self,
        notes: Sequence[str],
        losses: Mapping[str, int | None],
        left_out: Sequence[tuple[StoredChannel, Loss]],
    ) -> Survey:
        """Return the survey of the messages entered."""
        for topic in self._topics.values():
            if topic.msgtype == CLOUD:
                topic.forward_ns = self._forward.forward(topic.header_ns)
            self._end_turns(topic)
        invalid = {
            f'the transforms {parent} -> {child} of /tf are no transforms: NaN, infinite or without'
            f' rotation': count
            for (parent, child), count in self._links.invalid().items()
        }
        losses = {**losses, **invalid}
        static, moving, _ = self._links.sorted()
        found = static, moving, self._links.changes(), self._calibrations, notes, losses, left_out
        return Survey(self._topics, *found, self._links.clashes)

    def _take(self, message: BagMessage) -> None:
        topic = self._topics[message.topic]
        topic.log_ns.append(message.stamp_ns)
        topic.size_bytes += size_of(message.data)
        if topic.msgtype in TF_TYPES:
            decoded = self._decoded(topic, message)
            if decoded is not None:
                self._links.add(
                    decoded, still='static' in topic.name, topic=topic.name, log_ns=message.stamp_ns
                )
            first_ns = stamp_ns_of(decoded.transforms[0].header) if _has_links(decoded) else 0
            topic.links_ns.append(first_ns or message.stamp_ns)
        elif topic.msgtype in READ:
            self._look_at(topic, message)
        elif topic.name == CALIBRATION and topic.msgtype == STRING:
            text = self._decoded(topic, message)
            if text is not None:
                self._calibrations.append((message.stamp_ns, decode_text(text)))
        elif topic.name in ForwardStamps.topics and topic.msgtype == STRING:
            self._take_source(topic, message)

    def _take_source(self, topic: TopicSurvey, message: BagMessage) -> None:
        text = self._decoded(topic, message)
        if text is None:
            return
        try:
            self._forward.take(topic.name, text, message.stamp_ns)
        except ValueError as error:
            topic.fail(error)

    def _look_at(self, topic: TopicSurvey, message: BagMessage) -> None:
        if topic.msgtype in HEADED:
            _enter_header(topic, message)
            self._enter_copy(topic, message)
            self._enter_content(topic, message)
        elif topic.msgtype == MARKERS:
            _enter_first_stamp(topic, message)
        if isinstance(message.data, MessageStart):
            return
        is_due, look = _is_look(topic, topic.count), None
        if is_due or _is_sampled(topic):
            look = self._decoded(topic, message)
        if look is not None:
            if is_due:
                _keep(topic, look)
            _count_classes(topic, look)
            topic.moves = topic.moves or (topic.msgtype in _WITH_TWIST and has_motion(look))
        if topic.msgtype == FIX:
            topic.places = topic.places or array('d')
            topic.places.extend(place_of(look))
        elif topic.msgtype in SCAN_TYPES and not (topic.msgtype == CLOUD and self._is_own):
            self._enter_turn(topic, message, look)

    def _enter_turn(self, topic: TopicSurvey, message: BagMessage, look: Any) -> None:  # noqa: ANN401
        """Enter the times of the first and last point of a message; look is it decoded, or None."""
        if topic.name in self._turns and look is None:
            with suppress(ValueError):  # the conversion enters it as a loss
                look = self._decode_lent(message)
        elif look is not None and has_times(look):
            self._turns.setdefault(topic.name, TurnTimes())
        timed = look is not None and topic.name in self._turns
        topic.spans_ns = topic.spans_ns or []
        topic.spans_ns.append(self._turns[topic.name].span_ns(look) if timed else None)

    def _end_turns(self, topic: TopicSurvey) -> None:
        """Read the times of the first message again, by the unit that later ones have told."""
        if topic.spans_ns and topic.looks and topic.name in self._turns and not topic.failures:
            topic.spans_ns[0] = self._turns[topic.name].span_ns(topic.looks[0])

    def _enter_content(self, topic: TopicSurvey, message: BagMessage) -> None:
        """Enter the content of a CameraInfo if it differs from the one before, header apart."""
        if topic.msgtype != CAMERA_INFO:
            return
        body = body_after_header(message.data)
        if body == self._bodies.get(topic.name):
            return
        self._bodies[topic.name] = body
        look = self._contents.get((topic.name, body)) or self._decoded(topic, message)
        if look is not None:
            self._contents[topic.name, body] = look
            topic.contents.append((topic.count - 1, look))

    def _enter_copy(self, topic: TopicSurvey, message: BagMessage) -> None:
        """Enter a message with boxes that is the same as an earlier one."""
        if topic.msgtype in BOXES:
            known = self._known[topic.name]
            key = topic.header_ns[-1], hash(body_after_header(message.data))
            if key in known:
                topic.copies.append(topic.count - 1)
            known.add(key)

    def _decoded(self, topic: TopicSurvey, message: BagMessage) -> Any:  # noqa: ANN401
        try:
            return self._decode(message)
        except ValueError as error:
            topic.fail(error)
            return None


def _has_links(message: Any) -> bool:  # noqa: ANN401 - of the bag's types
    return message is not None and bool(message.transforms)


def _enter_header(topic: TopicSurvey, message: BagMessage) -> None:
    try:
        stamp_ns, frame = peek_header(message.data)
    except ValueError:
        topic.headless.append(len(topic.header_ns))
        topic.header_ns.append(message.stamp_ns)
        return
    topic.header_ns.append(stamp_ns)
    topic.frames[frame.lstrip('/')] += 1


def _enter_first_stamp(topic: TopicSurvey, message: BagMessage) -> None:
    """Enter the stamp of the first marker; without one that of the log, as late as those before."""
    stamp_ns = peek_first_stamp(message.data)
    topic.markers_ns.append(stamp_ns)
    lead_ns = topic.header_ns[-1] - topic.log_ns[-2] if topic.header_ns else 0
    topic.header_ns.append(stamp_ns or message.stamp_ns + lead_ns)


def _is_look(topic: TopicSurvey, count: int) -> bool:
    """Whether the message of a count, from 1, is one to decode."""
    return not topic.looks or (count.bit_count() == 1 and len(topic.looks) < _LOOKS)


def _keep(topic: TopicSurvey, look: Any) -> None:  # noqa: ANN401 - of the bag's types
    """Keep a decoded message; of images, which are large, those up to the first with a size."""
    if topic.msgtype not in PICTURES or not any(map(image_size, topic.looks)):
        topic.looks = [*topic.looks, look][:_LOOKS]


def _is_sampled(topic: TopicSurvey) -> bool:
    """Whether the last message is decoded for more than a look.

    Places are those of all; classes are counted in some, for decoding all takes too long; of
    velocities one that is not 0 is enough.
    """
    if topic.msgtype in SOLID:
        return topic.count <= _ALL_OF_FIRST or topic.count % _EVERY == 0
    return topic.msgtype == FIX or (topic.msgtype in _WITH_TWIST and not topic.moves)


def _count_classes(topic: TopicSurvey, look: Any) -> None:  # noqa: ANN401 - of the bag's types
    if topic.msgtype in SOLID:
        with suppress(ValueError):
            boxes = boxes_in(look)
            topic.classes.update(each.class_name for each in boxes)
            topic.has_tracks |= any(each.identity for each in boxes)
