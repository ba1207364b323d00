# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Survey of a bag in one pass: stamps, frames, calibration, and a few messages of each topic.

Of large messages only the header is parsed, so the pass is as fast as reading the bag.
"""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.bag_files import opened
from ..bags.container_file import MessageStart, size_of
from ..bags.reader import Decoder, ForwardStamps, open_messages
from ..kitti.names import OTHER_RIGS
from ..messages.cdr import body_after_header, peek_first_stamp, peek_header, stamp_ns_of
from ..messages.clouds import TurnTimes, has_times
from ..messages.detections import boxes_in
from ..messages.naming import CALIBRATION, PRESETS, RECORDING
from ..messages.oxts import has_motion, position_of
from ..messages.scan_sources import SCAN_TYPES
from ..messages.source_texts import decode_texts
from ..messages.tf_tree import FrameTree, LinkTally
from ..messages.videos import begins_video, is_video, picture_size
from ..model import bag_formats as types
from ..model.bag_formats import (
    CAMERA_INFO,
    CLOUD,
    FIX,
    LARGE_TYPES,
    MARKERS,
    PICTURES,
    STRING,
    TF_TYPES,
    VIDEOS,
)
from ..model.errors import Loss, UsageError, did_you_mean
from ..model.streams import NS_PER_S, Layout
from .plan import LABELS, ROLES, VELOCITY

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from ..bags.bag_files import BagSource
    from ..bags.container_file import StoredChannel
    from ..bags.reader import BagMessage, BagMessages
    from ..messages.tf_tree import Link
    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Int64Array, TextFile


# The message types that a survey reads.

SOLID = frozenset(LABELS.msgtypes)
"""Types with 3D boxes."""

BOXES = frozenset(LABELS.every_type) - {types.MARKERS}
"""Types with boxes that begin with a Header."""

_PLANNED = frozenset(msgtype for role in ROLES for msgtype in role.every_type)

HEADED = _PLANNED - {types.MARKERS}
"""Types that begin with a Header."""

READ = _PLANNED | types.TF_TYPES
"""Types of which some messages are decoded."""

DESCRIBING = types.TF_TYPES | SOLID | BOXES | {types.CAMERA_INFO, types.STRING}
"""Types that describe the sensors, or what they see."""

FIRST_ONLY = types.LARGE_TYPES | types.VIDEOS | SCAN_TYPES
"""Types of which survey_sensors reads the first message."""


# The stamps of a topic that are used.


def usable_stamps(header_ns: Int64Array, log_ns: Int64Array) -> tuple[Int64Array, str | None]:
    """Select the stamps to use: header stamps, or log times where those are invalid.

    Args:
        header_ns: (N,) nanoseconds, in the order of the log.
        log_ns: (N,) nanoseconds.

    Returns:
        The stamps, and the reason for log times: most header stamps are 0, one is before 1970, or
        more than a second earlier than one before; None for header stamps. Of these, those that are
        not set get the median distance that the others have from log times.
    """
    unset = unset_stamps(header_ns)
    if 0 < 2 * np.count_nonzero(unset) < len(header_ns):
        lead_ns = np.sort((header_ns - log_ns)[~unset])
        header_ns = np.where(unset, log_ns + lead_ns[len(lead_ns) // 2], header_ns)
        unset[:] = False
    for is_wrong, fault in (
        (unset, '0'),
        (header_ns < 0, 'before 1970'),
        (late_ns(header_ns) > NS_PER_S, 'more than a second earlier than one before'),
    ):
        wrong = np.flatnonzero(is_wrong)
        if len(wrong):
            verb = 'is' if len(wrong) == 1 else 'are'
            return log_ns, (
                f'{len(wrong)} of {len(header_ns)} header stamps {verb} {fault}'
                f' (the first that of message {wrong[0] + 1}); log time is used'
            )
    return header_ns, None


def unset_stamps(stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
    """Return (N,) which stamps are not set: 0.

    The first may be 0 if the next one follows within a second: the time of simulators begins there.
    """
    unset: npt.NDArray[np.bool_] = stamps_ns == 0
    if len(stamps_ns) > 1 and 0 < stamps_ns[1] <= NS_PER_S:
        unset[0] = False
    return unset


def late_ns(stamps_ns: Int64Array) -> Int64Array:
    """Return (N,) the nanoseconds by which stamps are earlier than the latest one before them."""
    latest: Int64Array = np.maximum.accumulate(stamps_ns)
    return latest - stamps_ns


# The messages of a topic of labels that belong together: those of one stamp.
#
# Some publishers send the boxes of a stamp in several arrays, one a class; several detectors may
# share a topic. A MarkerArray has no stamp of its own, its markers have; one without markers
# belongs to the nearest others.


def group_messages(stamps_ns: Sequence[int], log_ns: Sequence[int]) -> list[list[int]]:
    """Group messages by stamp; each is alone unless another one has its stamp.

    Args:
        stamps_ns: (N,) stamps; 0 for an array of markers without one, negative for no stamp.
        log_ns: (N,) log times, in the order of reading.

    Returns:
        The indices of each group's messages, groups in the order of their first ones.
    """
    stamps = np.array(stamps_ns, dtype=np.int64)
    alone = [[index] for index in range(len(stamps))]
    distinct = np.unique(stamps[stamps > 0])
    # Stamps that never change group nothing.
    if len(distinct) < 2 or len(distinct) == np.count_nonzero(stamps > 0):
        return alone
    logs = np.array(log_ns, dtype=np.int64)
    starts = np.full(len(distinct), np.iinfo(np.int64).max)
    np.minimum.at(starts, np.searchsorted(distinct, stamps[stamps > 0]), logs[stamps > 0])
    near_ns = int(np.median(np.diff(np.sort(starts)))) // 2
    groups: dict[int, list[int]] = defaultdict(list)
    for index, stamp in enumerate(stamps.tolist()):
        key = stamp if stamp > 0 else -1 - index
        if not stamp:
            gaps = np.where(stamps > 0, np.abs(logs - logs[index]), np.iinfo(np.int64).max)
            nearest = int(np.argmin(gaps))
            key = int(stamps[nearest]) if gaps[nearest] <= near_ns else -1 - index
        groups[key].append(index)
    return sorted(groups.values())


# Survey of one topic: its stamps, frames, and a few of its messages.


@dataclass(slots=True)
class TopicSurvey:
    """One topic.

    Attributes:
        name, msgtype: As the bag has them.
        log_ns: Log times in the order of reading, nanoseconds.
        header_ns: Header stamps of the same messages; empty where the type has no header.
        frame_ids: Of the headers, with the number of messages of each.
        samples: A few decoded messages, at doubling distances.
        failures: Number of messages that failed to decode.
        failure: The reason of the first failure, empty without one.
        headless: Indices of the messages without a readable header.
        contents: CameraInfo: its content where that differs from the message before, each with
            the index of its message.
        size_bytes: Size of its messages as CDR; of large ones of ROS 1 as stored.
        links_ns: TFMessages: stamps of the first transforms, log times where they are 0.
        positions: NavSatFix: latitude, longitude and altitude of each, NaN without a fix.
        moves: Messages with a twist: whether one has a velocity that is not 0.
        markers_ns: MarkerArrays: stamps of the first markers, 0 without one.
        copies: Topics with boxes: indices of messages that are the same as an earlier one.
        forward_ns: Header stamp to the stamp of the frame, where they differ: see forward_stamps.
        classes: Topics with boxes: number of boxes of each class in the messages decoded.
        has_tracks: Topics with boxes: whether one of these names its track.
        spans_ns: Scans with a time for each point: when the first and the last point of each
            message were measured, nanoseconds from the stamp; None where it does not say.
        keys: Videos: indices of the messages at which decoding can begin; None for other topics.
        by_log: Whether log times are used, not stamps.
        offset_ns: Added to the stamps, nanoseconds.
        middles_ns: (N,) added to header stamps, nanoseconds: the way to the middle of each turn.
    """

    name: str
    msgtype: str
    log_ns: array[int] = field(default_factory=lambda: array('q'))
    header_ns: array[int] = field(default_factory=lambda: array('q'))
    frame_ids: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    samples: list[Any] = field(default_factory=list)
    failures: int = 0
    failure: str = ''
    headless: list[int] = field(default_factory=list)
    contents: list[tuple[int, Any]] = field(default_factory=list)
    size_bytes: int = 0
    links_ns: list[int] = field(default_factory=list)
    positions: array[float] | None = None
    moves: bool = False
    markers_ns: list[int] = field(default_factory=list)
    copies: list[int] = field(default_factory=list)
    forward_ns: Mapping[int, int] = field(default_factory=dict)
    classes: Counter[str] = field(default_factory=Counter)
    has_tracks: bool = False
    spans_ns: list[tuple[int, int] | None] | None = None
    keys: list[int] | None = None
    by_log: bool = False
    offset_ns: int = 0
    middles_ns: Int64Array | None = None

    def fail(self, error: ValueError) -> None:
        """Count a message that failed to decode."""
        self.failures += 1
        self.failure = self.failure or str(error)

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self.log_ns)

    @property
    def fixes(self) -> Float64Array:
        """Latitude, longitude (degrees) and altitude of each NavSatFix, (N, 3).

        The altitude is NaN where it is not known, and all three without a fix.
        """
        return np.array(self.positions or (), np.float64).reshape(-1, 3)

    @property
    def has_fix(self) -> bool:
        """Return whether a NavSatFix has a fix."""
        return bool(np.isfinite(self.fixes[:, 0]).any())

    @property
    def is_readable(self) -> bool:
        """Return whether a message can be decoded, or was not tried."""
        return self.count > self.failures

    def undecoded(self) -> Loss:
        """Return the messages that failed to decode as a loss, with the first reason."""
        extent = '' if self.is_readable else 'not one of its messages can be read; the first '
        count = max(self.failures, len(self.headless))
        reason = self.failure or 'a header cannot be decoded'
        return Loss(self.name, count, f'{self.name}: {extent}{reason}')

    @property
    def frame_id(self) -> str:
        """The frame of most messages, without a leading slash."""
        return max(self.frame_ids, key=lambda name: self.frame_ids[name]) if self.frame_ids else ''

    @property
    def has_own_stamps(self) -> bool:
        """Return whether stamps of the messages are used, not log times."""
        if self.by_log:
            return False
        return bool(self.links_ns) or (bool(self.header_ns) and self._stamps()[1] is None)

    @property
    def turn_ns(self) -> tuple[int, int] | None:
        """When the first and the last point were measured, nanoseconds from the stamp: medians."""
        spans = [span for span in self.spans_ns or () if span is not None]
        if not spans:
            return None
        start, end = (int(limit_ns) for limit_ns in np.median(np.array(spans), axis=0))
        return start, end

    def turns_ns(self) -> Int64Array | None:
        """Return (N, 2) the same of each message, the medians of those that do not say."""
        usual = self.turn_ns
        if usual is None or self.spans_ns is None or len(self.spans_ns) != self.count:
            return None
        return np.array([usual if span is None else span for span in self.spans_ns], np.int64)

    def moved_ns(self) -> Int64Array:
        """Return (N,) the nanoseconds that are added to header stamps for the middle of turns."""
        if self.middles_ns is None or self._stamps()[1] is not None:
            return np.zeros(self.count, np.int64)
        return self.middles_ns

    def clock_ns(self) -> Int64Array:
        """Return (N,) stamps by which clocks are compared: also of TFMessages, without a header."""
        if self.by_log or not self.links_ns:
            return self.stamps()[0]
        return np.array(self.links_ns, dtype=np.int64) + self.offset_ns

    def stamps(self) -> tuple[Int64Array, str | None]:
        """Select the stamps to use, (N,) nanoseconds in the order of reading.

        Header stamps of 0 or out of order are invalid; log times are used instead, and the reason
        is returned. The offset is added.
        """
        used, reason = self._stamps()
        if self.middles_ns is not None and reason is None:
            used = used + self.middles_ns
        return (used + self.offset_ns if self.offset_ns else used), reason

    def groups(self) -> list[list[int]] | None:
        """Return the indices of messages with boxes that belong together; None if each is alone.

        Copies are alone: where a recorder writes all messages twice, scans are copied, too.
        """
        stamps_ns: Sequence[int] = self.markers_ns
        if self.msgtype in BOXES:
            alone = {*self.copies, *self.headless}
            stamps_ns = [
                -1 if index in alone else stamp or -1 for index, stamp in enumerate(self.header_ns)
            ]
        if len(stamps_ns) != self.count:
            return None
        groups = group_messages(stamps_ns, self.log_ns)
        return groups if len(groups) < self.count else None

    def stamp_notes(self) -> Iterator[str]:
        """Yield notes where header stamps are not used, and where they repeat."""
        _, reason = self.stamps()
        if reason is not None:
            yield f'{self.name}: {reason}'
        if self.by_log or len(self.header_ns) != self.count:
            return
        header = np.array(self.header_ns, dtype=np.int64)
        if reason is None:
            yield from self._used_stamp_notes(header)
        again = np.flatnonzero(np.diff(header) == 0) + 1
        again = again[header[again] != 0]
        if self.groups() is not None:  # messages with one stamp are one sample: see label_groups
            again = again[np.isin(again, self.copies)]
        if len(again):
            yield (
                f'{self.name}: {len(again)} of {len(header)} messages have the stamp of the one'
                f' before (the first is message {again[0] + 1}); each is a sample of its own'
            )

    def _used_stamp_notes(self, header_ns: Int64Array) -> Iterator[str]:
        """Yield notes on header stamps that are used, and are 0 or out of order."""
        unset = np.flatnonzero(unset_stamps(header_ns))
        if len(unset):
            yield (
                f'{self.name}: header stamps that are 0: {len(unset)} of {len(header_ns)} (the'
                f' first that of message {unset[0] + 1}); they get the log time, moved by the'
                f' distance of the others'
            )
        late = late_ns(np.delete(header_ns, unset))
        if late.any():
            yield (
                f'{self.name}: messages whose stamps are before that of an earlier one:'
                f' {np.count_nonzero(late)} of {len(header_ns)}, by {late.max() / 1e6:.1f} ms at'
                f' most; they are taken in the order of their stamps'
            )

    def _stamps(self) -> tuple[Int64Array, str | None]:
        log = np.array(self.log_ns, dtype=np.int64)
        if self.by_log or len(self.header_ns) != len(self.log_ns) or len(self.headless) == len(log):
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


def unchosen_notes(stream: str, best: TopicSurvey, topics: Sequence[TopicSurvey]) -> list[str]:
    """Return a note of the topics that were not chosen for a stream; empty without any."""
    others = ', '.join(f'{topic.name} ({topic.count})' for topic in topics if topic is not best)
    return [f'passed over for {stream}: {others}'] if others else []


_MOST_SAMPLES = 8
_ALL_OF_FIRST = 64
_EVERY = 16
_WITH_TWIST = frozenset(VELOCITY.every_type)


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
        notes: Notes of the bag's reader.
        losses: Damage, and the number of messages lost by each; None: unknown.
        left_out: Topics that cannot be read.
        clashes: Links that are of several robots, each with the topics of two.
        tracklets: A raw drive in a bag written by to-bag: its boxes by stamp and track, whose
            occlusion and truncation no message has.
        other_rig: The calibration files of another rig than KITTI's in a bag written by to-bag,
            whose CameraInfo and static transforms have its numbers.
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
    other_rig: Sequence[TextFile] = ()

    @cached_property
    def tree(self) -> FrameTree:
        """The tree of all links."""
        return FrameTree(self.static, self.moving)

    @property
    def kitti_360_camera(self) -> str:
        """The frame of the rectified camera 0 in a bag of KITTI-360 by to-bag; empty in others.

        It is there without images, too.
        """
        if RECORDING not in self.topics:
            return ''
        cameras = Layout.KITTI_360.traits.camera_names
        own = (naming.frames_of(cameras).camera(0) for naming in PRESETS.values())
        return next((frame_id for frame_id in own if frame_id in self.tree.frames), '')

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
        return [topic for topic in self._of_type(msgtypes) if topic.is_readable]

    def unreadable(self, *msgtypes: str) -> list[TopicSurvey]:
        """Return the topics of some types without a message that can be decoded, by name."""
        return [topic for topic in self._of_type(msgtypes) if not topic.is_readable]

    def _of_type(self, msgtypes: Sequence[str]) -> list[TopicSurvey]:
        topics = [
            topic for topic in self.topics.values() if topic.msgtype in msgtypes and topic.count
        ]
        return sorted(topics, key=lambda topic: topic.name)


def topic_of(survey: Survey, name: str) -> TopicSurvey:
    """Return the survey of a topic that a plan names.

    Raises:
        UsageError: The bag has no such topic, or it has no messages.
    """
    topic = survey.topics.get(name)
    if topic is None or not topic.count:
        topics = sorted(other.name for other in survey.topics.values() if other.count)
        hint = did_you_mean(name, topics) or f'; it has {", ".join(topics)}'
        raise UsageError(
            f'the plan names {name or "an empty topic"}, of which the bag has no message{hint}'
        )
    return topic


def survey_bags(bags: Sequence[BagSource], topics: Collection[str] | None = None) -> Survey:
    """Survey bags in one pass.

    Args:
        bags: The bags.
        topics: The topics to read; all of them by default.

    Raises:
        BadBagError: One cannot be read.
    """
    with open_messages(bags, topics) as messages:
        survey_pass = _SurveyPass(messages)
        messages.skim(survey_pass.needs_start_only)
        survey_pass.take_all(messages)
        return survey_pass.survey(messages.notes, messages.losses, messages.left_out)


def survey_sensors(source: BagSource) -> Survey:
    """Survey the description of a bag's sensors, and the first message of topics of large ones.

    Raises:
        BadBagError: It cannot be read.
    """
    with opened(source) as bag:
        with open_messages(bag) as channels_only:
            types = dict(channels_only.channels)
            survey_pass = _SurveyPass(channels_only)
            losses, left_out = channels_only.losses, channels_only.left_out
        describing = {topic for topic, msgtype in types.items() if msgtype in DESCRIBING}
        if describing:
            with open_messages(bag, describing) as messages:
                survey_pass.take_all(messages)
        notes: list[str] = []
        for topic in (topic for topic, msgtype in types.items() if msgtype in FIRST_ONLY):
            with open_messages(bag, {topic}) as messages:
                survey_pass.take_all(islice(messages, 1))
                notes += messages.notes
    return survey_pass.survey(tuple(dict.fromkeys(notes)), losses, left_out)


class _SurveyPass:
    """Collects the survey while messages are read."""

    def __init__(self, messages: BagMessages) -> None:
        self._decode = Decoder(messages.typestore)
        self._decode_lent = Decoder(messages.typestore, lent=True)
        self._bodies: dict[str, bytes] = {}
        self._contents: dict[tuple[str, bytes], Any] = {}
        self._seen_boxes: dict[str, set[tuple[int, int]]] = defaultdict(set)
        self._topics = {name: TopicSurvey(name, msgtype) for name, msgtype in messages.channels}
        self._links = LinkTally()
        self._calibrations: list[tuple[int, TextFile]] = []
        self._other_rig: list[TextFile] = []
        self._forward = ForwardStamps()
        # Scans of to-bag are stamped facing forward.
        self._is_own = RECORDING in self._topics
        self._turns: dict[str, TurnTimes] = {}

    def take_all(self, messages: Iterable[BagMessage]) -> None:
        """Enter messages."""
        for message in messages:
            self._take(message)

    def needs_start_only(self, name: str) -> bool:
        """Return whether the next message of a topic is not decoded if it is large."""
        topic = self._topics[name]
        if topic.msgtype not in READ:
            return topic.msgtype != STRING
        is_due = _is_due(topic, topic.count + 1)
        is_whole = is_due or name in self._turns or topic.keys is not None
        return topic.msgtype in LARGE_TYPES and not is_whole

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
        results = static, moving, self._links.changes(), self._calibrations, notes, losses, left_out
        return Survey(self._topics, *results, self._links.clashes, other_rig=self._other_rig)

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
            self._take_sample(topic, message)
        elif topic.name == CALIBRATION and topic.msgtype == STRING:
            text = self._decoded(topic, message)
            if text is not None:
                self._take_calibration(topic, message.stamp_ns, text)
        elif topic.name in ForwardStamps.topics and topic.msgtype == STRING:
            self._take_source(topic, message)

    def _take_calibration(self, topic: TopicSurvey, stamp_ns: int, text: Any) -> None:  # noqa: ANN401
        try:
            for file in decode_texts(text):
                if PurePosixPath(file.name).name in OTHER_RIGS:
                    self._other_rig.append(file)
                else:
                    self._calibrations.append((stamp_ns, file))
        except ValueError as error:
            topic.fail(error)

    def _take_source(self, topic: TopicSurvey, message: BagMessage) -> None:
        text = self._decoded(topic, message)
        if text is None:
            return
        try:
            self._forward.take(topic.name, text, message.stamp_ns)
        except ValueError as error:
            topic.fail(error)

    def _take_sample(self, topic: TopicSurvey, message: BagMessage) -> None:
        if topic.msgtype in HEADED:
            _enter_header(topic, message)
            self._enter_copy(topic, message)
            self._enter_content(topic, message)
        elif topic.msgtype == MARKERS:
            _enter_first_stamp(topic, message)
        if isinstance(message.data, MessageStart):
            return
        is_due, sample = _is_due(topic, topic.count), None
        if is_due or _is_decoded(topic):
            sample = self._decoded(topic, message)
        if sample is not None:
            if is_due:
                _keep_sample(topic, sample)
            _count_classes(topic, sample)
            topic.moves = topic.moves or (topic.msgtype in _WITH_TWIST and has_motion(sample))
        self._enter_key(topic, message, sample)
        if topic.msgtype == FIX:
            topic.positions = topic.positions or array('d')
            topic.positions.extend(position_of(sample))
        elif topic.msgtype in SCAN_TYPES and not (topic.msgtype == CLOUD and self._is_own):
            self._enter_turn(topic, message, sample)

    def _enter_key(self, topic: TopicSurvey, message: BagMessage, sample: Any) -> None:  # noqa: ANN401
        """Enter a packet of a video at which decoding can begin; sample: decoded, or None."""
        if topic.keys is None:
            if sample is None or topic.msgtype not in PICTURES | VIDEOS or not is_video(sample):
                return
            topic.keys = []
        try:
            if begins_video(self._decode_lent(message) if sample is None else sample):
                topic.keys.append(topic.count - 1)
        except ValueError as error:
            topic.fail(error)

    def _enter_turn(self, topic: TopicSurvey, message: BagMessage, sample: Any) -> None:  # noqa: ANN401
        """Enter the times of the first and last point of a message; sample: decoded, or None."""
        if topic.name in self._turns and sample is None:
            with suppress(ValueError):  # the conversion enters it as a loss
                sample = self._decode_lent(message)
        elif sample is not None and has_times(sample):
            self._turns.setdefault(topic.name, TurnTimes())
        timed = sample is not None and topic.name in self._turns
        topic.spans_ns = topic.spans_ns or []
        topic.spans_ns.append(self._turns[topic.name].span_ns(sample) if timed else None)

    def _end_turns(self, topic: TopicSurvey) -> None:
        """Read the times of the first message again, by the unit found in later ones."""
        if topic.spans_ns and topic.samples and topic.name in self._turns and not topic.failures:
            topic.spans_ns[0] = self._turns[topic.name].span_ns(topic.samples[0])

    def _enter_content(self, topic: TopicSurvey, message: BagMessage) -> None:
        """Enter the content of a CameraInfo if it differs from the one before, header apart."""
        if topic.msgtype != CAMERA_INFO:
            return
        body = body_after_header(message.data)
        if body == self._bodies.get(topic.name):
            return
        self._bodies[topic.name] = body
        info = self._contents.get((topic.name, body)) or self._decoded(topic, message)
        if info is not None:
            self._contents[topic.name, body] = info
            topic.contents.append((topic.count - 1, info))

    def _enter_copy(self, topic: TopicSurvey, message: BagMessage) -> None:
        """Enter a message with boxes that is the same as an earlier one."""
        if topic.msgtype in BOXES:
            keys = self._seen_boxes[topic.name]
            key = topic.header_ns[-1], hash(body_after_header(message.data))
            if key in keys:
                topic.copies.append(topic.count - 1)
            keys.add(key)

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
        stamp_ns, frame_id = peek_header(message.data)
    except ValueError:
        topic.headless.append(len(topic.header_ns))
        topic.header_ns.append(message.stamp_ns)
        return
    topic.header_ns.append(stamp_ns)
    topic.frame_ids[frame_id.lstrip('/')] += 1


def _enter_first_stamp(topic: TopicSurvey, message: BagMessage) -> None:
    """Enter the stamp of the first marker; without one that of the log, as late as those before."""
    stamp_ns = peek_first_stamp(message.data)
    topic.markers_ns.append(stamp_ns)
    lead_ns = topic.header_ns[-1] - topic.log_ns[-2] if topic.header_ns else 0
    topic.header_ns.append(stamp_ns or message.stamp_ns + lead_ns)


def _is_due(topic: TopicSurvey, count: int) -> bool:
    """Return whether the message of a count, from 1, is one to decode."""
    return not topic.samples or (count.bit_count() == 1 and len(topic.samples) < _MOST_SAMPLES)


def _keep_sample(topic: TopicSurvey, sample: Any) -> None:  # noqa: ANN401 - of the bag's types
    """Keep a decoded message; of images, which are large, those up to the first with a size."""
    if topic.msgtype not in PICTURES | VIDEOS or not any(map(picture_size, topic.samples)):
        topic.samples = [*topic.samples, sample][:_MOST_SAMPLES]


def _is_decoded(topic: TopicSurvey) -> bool:
    """Return whether the last message is decoded for more than a sample.

    All positions are read; classes are counted in some, for decoding all takes too long; one
    velocity that is not 0 is enough.
    """
    if topic.msgtype in SOLID:
        return topic.count <= _ALL_OF_FIRST or topic.count % _EVERY == 0
    return topic.msgtype == FIX or (topic.msgtype in _WITH_TWIST and not topic.moves)


def _count_classes(topic: TopicSurvey, sample: Any) -> None:  # noqa: ANN401 - of the bag's types
    if topic.msgtype in SOLID:
        with suppress(ValueError):
            boxes = boxes_in(sample)
            topic.classes.update(box.class_name for box in boxes)
            topic.has_tracks |= any(box.identity for box in boxes)
