# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Survey of a bag in one pass: stamps, frames, calibration, and a few messages of each topic.

Of large messages only the header is parsed, so the pass is as fast as reading the bag.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.decoding import Decoder
from ..bags.forward_stamps import ForwardStamps
from ..bags.reader import open_messages, opened
from ..messages.header import body_after_header, peek_first_stamp, peek_header
from ..messages.source import CALIBRATION, decode_text
from ..model.msgtypes import CAMERA_INFO, CLOUD, MARKERS, STRING, TF_TYPES
from ..rig.tf_tree import LinkTally
from .survey_types import DESCRIBING, FIRST_ONLY, HEADED, READ
from .sync import usable_stamps

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from ..bags.pieces import StoredChannel
    from ..bags.reader import BagMessage, BagMessages, BagSource
    from ..model.losses import Loss
    from ..model.samples import Int64Array, TextFile
    from ..rig.tf_tree import Link


_LOOKS = 8


@dataclass
class TopicSurvey:
    """One topic.

    Attributes:
        name, msgtype: As the bag has them.
        log_ns: Log times in the order of reading, nanoseconds.
        header_ns: Header stamps of the same messages; empty where the type has no header.
        frames: Header frames, with the number of messages of each.
        looks: A few decoded messages, at doubling distances.
        failures: Number of messages that failed to decode.
        failure: The reason of the first failure, empty without one.
        headless: Indices of the messages without a readable header.
        changes: Of CameraInfo: number of changes of its content.
        size_bytes: Of its messages as CDR.
        markers_ns: Of a MarkerArray: stamps of the first markers, 0 without one.
        forward_ns: Header stamp to the stamp of the frame, where they differ: see forward_stamps.
    """

    name: str
    msgtype: str
    log_ns: list[int] = field(default_factory=list)
    header_ns: list[int] = field(default_factory=list)
    frames: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    looks: list[Any] = field(default_factory=list)
    failures: int = 0
    failure: str = ''
    headless: list[int] = field(default_factory=list)
    changes: int = 0
    size_bytes: int = 0
    markers_ns: list[int] = field(default_factory=list)
    forward_ns: Mapping[int, int] = field(default_factory=dict)

    def fail(self, error: ValueError) -> None:
        """Count a message that failed to decode."""
        self.failures += 1
        self.failure = self.failure or str(error)

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self.log_ns)

    @property
    def is_readable(self) -> bool:
        """Whether a message can be decoded, or was not tried."""
        return self.count > self.failures

    @property
    def frame(self) -> str:
        """The frame of most messages, without a leading slash."""
        return max(self.frames, key=lambda name: self.frames[name]) if self.frames else ''

    def stamps(self) -> tuple[Int64Array, str | None]:
        """Select the stamps to use, (N,) nanoseconds in the order of reading.

        Header stamps of 0 or out of order are invalid; log times are used instead, and the reason
        is returned.
        """
        log = np.array(self.log_ns, dtype=np.int64)
        if len(self.header_ns) != len(self.log_ns) or len(self.headless) == len(log):
            return log, None
        header = np.array(self.header_ns, dtype=np.int64)
        if self.headless:
            # A damaged one gets the distance to its neighbour in the log.
            headed = np.setdiff1d(np.arange(len(log)), self.headless)
            nearest = headed[np.maximum(np.searchsorted(headed, self.headless) - 1, 0)]
            header[self.headless] = log[self.headless] + header[nearest] - log[nearest]
        used, reason = usable_stamps(header, log)
        if reason is None and self.forward_ns:
            used = np.array([self.forward_ns.get(stamp, stamp) for stamp in used.tolist()])
        return used, reason


@dataclass(frozen=True)
class Survey:
    """The result of a pass.

    Attributes:
        topics: By name; unused types have counts only.
        static: Static transforms (parent, child, parent_T_child), including those of /tf that never
            move.
        moving: (parent, child) of the others.
        changing: (parent, child) of static links that were published again with another value.
        calibrations: The calibration files in a bag written by to-bag, each with the stamp from
            which it is valid, in order.
        notes: Non-fatal remarks of the bag's reader.
        losses: Damage, and the number of messages lost by each; None: unknown.
        left_out: Topics that cannot be read.
    """

    topics: Mapping[str, TopicSurvey]
    static: Sequence[Link]
    moving: Sequence[tuple[str, str]]
    changing: Sequence[tuple[str, str]] = ()
    calibrations: Sequence[tuple[int, TextFile]] = ()
    notes: Sequence[str] = ()
    losses: Mapping[str, int | None] = field(default_factory=dict)
    left_out: Sequence[tuple[StoredChannel, Loss]] = ()

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
        self._bodies: dict[str, bytes] = {}
        self._topics = {name: TopicSurvey(name, msgtype) for name, msgtype in messages.channels}
        self._links = LinkTally()
        self._calibrations: list[tuple[int, TextFile]] = []
        self._forward = ForwardStamps()

    def take_all(self, messages: Iterable[BagMessage]) -> None:
        """Enter messages."""
        for message in messages:
            self._take(message)

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
        found = *self._links.sorted(), self._calibrations, notes, losses, left_out
        return Survey(self._topics, *found)

    def _take(self, message: BagMessage) -> None:
        topic = self._topics[message.topic]
        topic.log_ns.append(message.stamp_ns)
        topic.size_bytes += len(message.data)
        if topic.msgtype in TF_TYPES:
            decoded = self._decoded(topic, message)
            if decoded is not None:
                self._links.add(decoded, still='static' in topic.name)
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
        elif topic.msgtype == MARKERS:
            topic.markers_ns.append(peek_first_stamp(message.data))
        is_due = topic.count.bit_count() == 1 and len(topic.looks) < _LOOKS
        changed = topic.msgtype == CAMERA_INFO and self._is_news(topic, message)
        if is_due or changed or not topic.looks:
            look = self._decoded(topic, message)
            if look is not None:
                topic.changes += changed and bool(topic.looks)
                topic.looks = [*topic.looks, look][:_LOOKS]

    def _is_news(self, topic: TopicSurvey, message: BagMessage) -> bool:
        """Whether a message differs from the one before, header apart."""
        body = body_after_header(message.data)
        known = self._bodies.get(topic.name)
        self._bodies[topic.name] = body
        return body != known

    def _decoded(self, topic: TopicSurvey, message: BagMessage) -> Any:  # noqa: ANN401
        try:
            return self._decode(message)
        except ValueError as error:
            topic.fail(error)
            return None


def _enter_header(topic: TopicSurvey, message: BagMessage) -> None:
    try:
        stamp_ns, frame = peek_header(message.data)
    except ValueError:
        topic.headless.append(len(topic.header_ns))
        topic.header_ns.append(message.stamp_ns)
        return
    topic.header_ns.append(stamp_ns)
    topic.frames[frame.lstrip('/')] += 1
