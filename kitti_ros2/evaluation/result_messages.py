# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a topic with results, each with the frame that it belongs to.

A message belongs to the frame whose stamp is nearest to that in its header. Without such a stamp
(MarkerArrays may have none, some nodes use the time of the computer) it belongs to the last frame
before its arrival, in the time of the player's /clock.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

from ..bags.decoding import Decoder
from ..bags.reader import open_messages, path_of
from ..importer.report import LossTally
from ..messages.header import stamp_ns_of
from ..messages.topics import own_topics
from ..model.errors import BadBagError, UsageError
from ..model.losses import Loss
from ..model.msgtypes import (
    CLOCK,
    DETECTED_OBJECTS,
    DETECTIONS_2D,
    DETECTIONS_3D,
    MARKERS,
    TRACKED_OBJECTS,
)
from ..model.spelling import did_you_mean
from ..model.stamps import format_stamp, from_sec_nanosec
from ..model.text import format_count
from .frame_stamps import ROUNDED_NS, PlayedTime

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..bags.reader import BagSource
    from .frame_stamps import StampedFrames

_TYPES = frozenset({DETECTIONS_3D, DETECTIONS_2D, DETECTED_OBJECTS, TRACKED_OBJECTS, MARKERS})
_EXPECTED = (
    'a topic of Detection3DArray, Detection2DArray, DetectedObjects, TrackedObjects or MarkerArray'
)


class ResultMessage(NamedTuple):
    """A message with the results of a frame.

    Attributes:
        number: Of the frame.
        distance_ns: From the stamp of the frame, nanoseconds.
        stamp_ns: That in its header, else that of the frame.
        scan_ns: At which boxes in frames that do not move are placed: the stamp of the frame, or
            its own if that is one of the sensors' or an end of the turn.
        log_ns: Log time.
        message: Decoded.
    """

    number: int
    distance_ns: int
    stamp_ns: int
    scan_ns: int
    log_ns: int
    message: Any


class ResultMessages(NamedTuple):
    """The messages of a topic.

    Attributes:
        by_frame: By number of the frame, ascending.
        losses: Messages that cannot be decoded, belong to no frame or to one that has another
            message, and frames without one.
        damage: Of the topic, with the number of messages lost; None: unknown.
        notes: Remarks.
        unanswered: The frames without a message, ascending.
    """

    by_frame: Mapping[int, ResultMessage]
    losses: tuple[Loss, ...]
    damage: Mapping[str, int | None]
    notes: tuple[str, ...]
    unanswered: tuple[int, ...]


class _Received(NamedTuple):
    """A decoded message with its log time and the stamp in its header, None without one."""

    log_ns: int
    header_ns: int | None
    message: Any


def choose_topic(bag: BagSource, types: Mapping[str, str], topic: str | None) -> str:
    """Return the topic of the results.

    Args:
        bag: For errors.
        types: Type by topic of the bag.
        topic: As requested; None is the only one with boxes besides those of the recording itself.

    Raises:
        UsageError: There is none, or several.
    """
    path = path_of(bag)
    possible = [name for name, msgtype in types.items() if msgtype in _TYPES]
    if topic is None:
        foreign = [name for name in possible if name not in own_topics()]
        if not foreign:
            others = ' besides the labels of the recording' if possible else ''
            raise UsageError(f'{path}: has no results{others}; expected {_EXPECTED}')
        if len(foreign) > 1:
            raise UsageError(
                f'{path}: has several topics with boxes, {", ".join(foreign)}; choose one with'
                f' --topic'
            )
        return foreign[0]
    if topic not in types:
        shown = did_you_mean(topic, types) or f'; with boxes: {", ".join(possible) or "none"}'
        raise UsageError(f'{path}: has no topic {topic}{shown}')
    if types[topic] not in _TYPES:
        raise UsageError(f'{path}: {topic} is a {types[topic]}; expected {_EXPECTED}')
    return topic


def read_messages(
    bag: BagSource, types: Mapping[str, str], topic: str, frames: StampedFrames
) -> ResultMessages:
    """Read the messages of a topic and assign them to frames.

    Of several for one frame the one with the nearest stamp is used, of equally near ones the last.

    Args:
        bag: The bag.
        types: Type by topic of the bag.
        topic: With results.
        frames: Those of the recording.

    Raises:
        BadBagError: Not one message belongs to a frame.
    """
    tally = LossTally()
    received: list[_Received] = []
    with open_messages(bag, {topic}) as messages:
        decode = Decoder(messages.typestore)
        for each in messages:
            try:
                decoded = decode(each)
            except ValueError as error:
                tally.lose(topic, each.stamp_ns, str(error))
                continue
            received.append(_Received(each.stamp_ns, _header_ns(decoded), decoded))
        damage = messages.losses
    placed, notes = _place(bag, types, topic, received, frames)
    by_frame: dict[int, ResultMessage] = {}
    for found in placed:
        other = by_frame.get(found.number)
        if other is None or found.distance_ns <= other.distance_ns:
            by_frame[found.number] = found
    unanswered = tuple(number for number in frames.numbers if number not in by_frame)
    unused = (
        _strays(topic, received, placed, frames),
        _repeated(topic, placed),
        Loss(topic, len(unanswered), f'{topic}: no message for frames {{}}', unanswered),
    )
    losses = (*tally.losses(), *(loss for loss in unused if loss.count))
    return ResultMessages(dict(sorted(by_frame.items())), losses, damage, notes, unanswered)


def _header_ns(message: Any) -> int | None:  # noqa: ANN401 - of the bag's types
    """Return the first stamp after 1970 of a message and its boxes, None without one.

    Of markers those that are added come first.
    """
    inner = [*getattr(message, 'detections', ()), *getattr(message, 'markers', ())]
    added = sorted(inner, key=lambda each: getattr(each, 'action', 0) != 0)
    headers = [each.header for each in (message, *added) if hasattr(each, 'header')]
    return next((stamp for each in headers if (stamp := stamp_ns_of(each)) > 0), None)


def _place(
    bag: BagSource,
    types: Mapping[str, str],
    topic: str,
    received: Sequence[_Received],
    frames: StampedFrames,
) -> tuple[list[ResultMessage], tuple[str, ...]]:
    """Return the messages that belong to a frame, and notes.

    Raises:
        BadBagError: None does.
    """
    stamped = [each for each in received if each.header_ns is not None]
    placed = [
        _placed(*found, each.header_ns, each, frames)
        for each in stamped
        if each.header_ns is not None and (found := frames.nearest(each.header_ns))
    ]
    others = [each for each in received if each.header_ns is None] if placed else received
    if others:
        time = _played_time(bag, types)
        arrived = [
            _placed(*found, frames.stamp_of(found[0]), each, frames)
            for each in others
            if (found := frames.latest(time.at(each.log_ns)))
        ]
        if not placed and not arrived:
            raise _no_frame(bag, topic, received, frames)
        note = (
            f'{topic}: {format_count(len(others), "message")} without a stamp of the recording;'
            f' each is taken for the last frame before its arrival'
        )
        return placed + arrived, (note,)
    if not placed:
        raise BadBagError(path_of(bag), f'has no readable message on {topic}', 'results')
    return placed, ()


def _placed(
    number: int, distance_ns: int, stamp_ns: int, received: _Received, frames: StampedFrames
) -> ResultMessage:
    """Return a message of a frame.

    A detector that gives the stamp of its scan has brought its boxes into the world by the pose at
    that stamp, whatever it is of the turn.
    """
    scan_ns = stamp_ns if distance_ns <= ROUNDED_NS else frames.moment_of(number)
    return ResultMessage(number, distance_ns, stamp_ns, scan_ns, received.log_ns, received.message)


def _no_frame(
    bag: BagSource, topic: str, received: Sequence[_Received], frames: StampedFrames
) -> BadBagError:
    stamp_ns = received[0].header_ns or received[0].log_ns
    found = (
        f'none of the {format_count(len(received), "message")} of {topic} belongs to a frame: they'
        f' begin at {format_stamp(stamp_ns)}, the frames at {format_stamp(frames.first_ns)}'
    )
    expected = 'the stamps that the frames were played with (--epoch and --period change them)'
    return BadBagError(path_of(bag), found, expected)


def _played_time(bag: BagSource, types: Mapping[str, str]) -> PlayedTime:
    """Read the time of the player; messages of /clock that cannot be decoded are passed over."""
    topics = {name for name, msgtype in types.items() if msgtype == CLOCK}
    log_ns, clock_ns = [], []
    if topics:
        with open_messages(bag, topics) as messages:
            decode = Decoder(messages.typestore)
            for each in messages:
                try:
                    clock = decode(each).clock
                except ValueError:
                    continue
                log_ns.append(each.stamp_ns)
                clock_ns.append(from_sec_nanosec(clock.sec, clock.nanosec))
    return PlayedTime(log_ns, clock_ns)


def _strays(
    topic: str,
    received: Sequence[_Received],
    placed: Sequence[ResultMessage],
    frames: StampedFrames,
) -> Loss:
    """Return the messages that belong to no frame as a loss; its count may be 0."""
    kept = {id(each.message) for each in placed}
    strays = [each for each in received if id(each.message) not in kept]
    first = format_stamp(strays[0].header_ns or strays[0].log_ns) if strays else ''
    text = (
        f'{topic}: no frame within {frames.tolerance_ns / 1e6:.1f} ms of the stamp of messages, the'
        f' first at {first}'
    )
    return Loss(topic, len(strays), text)


def _repeated(topic: str, placed: Sequence[ResultMessage]) -> Loss:
    """Return the further messages of frames as a loss; its count may be 0."""
    counts = Counter(each.number for each in placed)
    several = tuple(sorted(number for number, count in counts.items() if count > 1))
    text = f'{topic}: several messages for frames {{}}; the nearest in time is used, or the last'
    return Loss(topic, len(placed) - len(counts), text, several)
