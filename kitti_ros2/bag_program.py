# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as something to play."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .bags.forward_stamps import read_lead_ns
from .bags.reader import index_bag, open_messages
from .errors import BadBagError, KittiRos2Error, UsageError
from .importer.numbering import BY_POSITION, number_bag
from .messages.cdr import filling
from .messages.topics import LARGE_TYPES, match_names
from .program import Due, Missing, Outlet
from .schedule import nearest_frames, never_falling

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from .bags.message_source import BagMessage, BagMessages
    from .messages.ros_types import Typestore
    from .options import Bound, SelectionOptions
    from .samples import Int64Array

_SCAN = 'sensor_msgs/msg/PointCloud2'
_OF_CAMERA = frozenset(
    {'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/CameraInfo'}
)
_DEPTH = 10


class BagProgram:
    """The messages of a bag, as they are; for one fetching thread at a time.

    Frames of a bag of our own have KITTI's numbers. In another one a frame is what is nearest to a
    message of the reference topic: the first with point clouds, else that of a camera, else the one
    with most messages; frames count from 0.

    Args:
        path: An .mcap, .db3 or .bag file, or a directory of rosbag2.
        selection: Topics, and the first and last moment, both included.
        reserved: Given a topic and its type, why the player keeps that topic to itself, or nothing;
            the bag's messages of it are left out.

    Raises:
        BadBagError: It cannot be read.
        UsageError: The selection takes nothing, or names streams.
    """

    workers = 1

    def __init__(
        self,
        path: Path,
        selection: SelectionOptions,
        reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
    ) -> None:
        if selection.streams:
            raise UsageError('a bag has topics, no streams; choose by topics')
        self._path = path
        bag_index = index_bag(path)
        stamps = bag_index.by_topic()
        kept = {key[0]: why for key in bag_index.stamps if (why := reserved(*key))}
        wanted = match_names(sorted(stamps), selection.topics)
        self._notes = tuple(
            f'{path}: {len(stamps[topic])} messages of {topic} are left out: {kept[topic]}'
            for topic in wanted
            if topic in kept and len(stamps[topic])
        )
        wanted = [topic for topic in wanted if topic not in kept]
        if not wanted and self._notes:
            raise UsageError(self._notes[0])
        self.name = path.name
        # What cannot be read is an error only where it is asked for by its full name.
        with open_messages(path, wanted if {*wanted} == {*selection.topics} else None) as messages:
            # The index also counts what is not CDR.
            read = {topic for topic, _ in messages.channels if len(stamps.get(topic, ()))}
            self._topics = frozenset(read & {*wanted})
            if not self._topics:
                raise BadBagError(path, 'holds no message of these topics', 'one at least')
            self.typestore: Typestore = messages.typestore
            self.losses = tuple(dict.fromkeys((*bag_index.warnings, *messages.warnings)))
            self.outlets: Sequence[Outlet] = [
                Outlet(
                    topic,
                    msgtype,
                    topic in messages.latched,
                    messages.latched.get(topic, _DEPTH),
                    msgtype in LARGE_TYPES,
                )
                for topic, msgtype in messages.channels
                if topic in self._topics
            ]
        self._index = {outlet.name: index for index, outlet in enumerate(self.outlets)}
        self._numbered = number_bag(path, stamps)
        every = np.sort(np.concatenate([stamps[topic] for topic in self._topics]))
        own = self._own_frames(every, stamps)
        begin = min(int(found[0]) for found in stamps.values() if len(found))
        bounds = (selection.start, selection.end)
        first, last = (
            _bound_ns(bound, every, own, (begin, side)) for side, bound in enumerate(bounds)
        )
        span = slice(*np.searchsorted(every, [first, last + 1]))
        taken = every[span]
        if selection.start and selection.end and every[0] <= last < first <= every[-1]:
            raise selection.reversed_error()
        if not len(taken):
            there = f'{len(every)}; it has frames {own.min()} to {own.max()}'
            raise UsageError(f'{path}: the selection takes no message of {there}')
        self.stamps_ns: Int64Array = taken
        self.frames = never_falling(own)[span]
        if selection.end is not None and selection.end.frame is not None:
            # What precedes the last of a frame is played with it.
            self.frames = np.minimum(self.frames, selection.end.frame)
        self._latched = self._read_latched(int(taken[-1]))
        self._messages: BagMessages | None = None
        self._iterator: Iterator[BagMessage] | None = None
        self._next = 0

    def _own_frames(self, every: Int64Array, stamps: Mapping[str, Int64Array]) -> Int64Array:
        """(N,) the frame of each message played, in order of time; one may fall behind another."""
        numbered = self._numbered
        if numbered is None:
            reference = _reference(self._path, stamps)
            return nearest_frames(every, reference, np.arange(len(reference)))
        return numbered.frames_at(every, self._topics)

    def notes(self) -> tuple[str, ...]:
        """As Program has it."""
        return self._notes if self._numbered is not None else (*self._notes, BY_POSITION)

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Due], list[Missing]]:
        """As Program has it."""
        try:
            message = self._read(index)
        except (KittiRos2Error, OSError) as error:
            self._iterator = None
            return [], [Missing(str(error), 1)]
        if message is None or message.stamp_ns != self.stamps_ns[index]:
            self._iterator = None
            return [], [Missing(self._reason(), 1)]
        outlet = self._index[message.topic]
        if self.outlets[outlet].on_demand and outlet not in wanted:
            return [Due(outlet, message.stamp_ns, b'')], []
        return [_due(outlet, message)], []

    def latched_before(self, index: int) -> list[Due]:
        """As Program has it."""
        last: dict[int, list[Due]] = {}
        for message in self._latched:
            if message.stamp_ns >= self.stamps_ns[index]:
                break
            have = last.setdefault(message.outlet, [])
            if have and have[0].stamp_ns != message.stamp_ns:
                have.clear()
            have.append(message)
        return [message for messages in last.values() for message in messages]

    def close(self) -> None:
        """Let go of the files; a thread of another's may have opened them."""
        self._iterator = self._messages = None

    def _read(self, index: int) -> BagMessage | None:
        """The message at a position; where it is not the next one, the bag is entered anew."""
        if self._iterator is None or index != self._next:
            if self._messages is None:
                self._messages = open_messages(self._path, self._topics)
            stamp = self.stamps_ns[index]
            self._iterator = self._messages.since(int(stamp))
            for _ in range(index - int(np.searchsorted(self.stamps_ns, stamp))):
                next(self._iterator, None)
        self._next = index + 1
        return next(self._iterator, None)

    def _reason(self) -> str:
        """Why a message that the index tells of does not come."""
        told = self._messages.warnings if self._messages is not None else ()
        new = [warning for warning in told if warning not in self.losses]
        return new[-1] if new else f'{self._path}: holds fewer messages than its index tells'

    def _read_latched(self, last_ns: int) -> list[Due]:
        topics = [outlet.name for outlet in self.outlets if outlet.latched]
        if not topics:
            return []
        with open_messages(self._path, topics) as messages:
            return [
                _due(self._index[message.topic], message)
                for message in messages
                if message.stamp_ns <= last_ns
            ]


def _due(outlet: int, message: BagMessage) -> Due:
    data = bytes(message.data)
    return Due(outlet, message.stamp_ns, data + filling(len(data)))


def _reference(path: Path, stamps: Mapping[str, Int64Array]) -> Int64Array:
    """The moments of the frames: the stamps of the topic by which frames are counted.

    Scans of our own that are stamped at their start count as half-way to facing forward.
    """
    with open_messages(path) as messages:
        channels = [each for each in messages.channels if len(stamps.get(each[0], ()))]
    scans = [topic for topic, msgtype in channels if msgtype == _SCAN]
    cameras = [topic for topic, msgtype in channels if msgtype in _OF_CAMERA]
    candidates = scans[:1] or cameras or [topic for topic, _ in channels]
    chosen = stamps[max(candidates, key=lambda topic: len(stamps[topic]))]
    # Images come after facing forward: the middle of both is in the middle of a frame.
    return chosen + read_lead_ns(path) // 2 if scans else chosen


def _bound_ns(bound: Bound | None, every: Int64Array, own: Int64Array, end: tuple[int, int]) -> int:
    """First (side 0) or last (side 1) stamp that a bound takes.

    Args:
        bound: None takes all.
        every: (N,) stamps of all messages, nanoseconds, ascending.
        own: (N,) the frame of each.
        end: The bag's first stamp, and the side.
    """
    begin, side = end
    if bound is None:
        return int(every[-1] if side else every[0])
    if bound.stamp_ns is not None:
        return bound.stamp_ns
    if bound.offset_ns is not None:
        return begin + bound.offset_ns
    frame = bound.frame or 0
    if side:
        taken = np.flatnonzero(own <= frame)
        return int(every[taken[-1]]) if len(taken) else int(every[0]) - 1
    taken = np.flatnonzero(own >= frame)
    return int(every[taken[0]]) if len(taken) else int(every[-1]) + 1
