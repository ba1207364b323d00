# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The program of a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..bags.forward_stamps import read_lead_ns
from ..bags.reader import index_bag, open_messages
from ..exporter.schedule import nearest_frames, never_falling
from ..messages.cdr import Message, filling
from ..model.errors import BadBagError, KittiRos2Error, UsageError
from ..model.losses import Loss
from ..own_bags.numbering import BY_POSITION, number_bag
from .bag_topics import AsItIs, choose_topics, define_images

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.message_source import BagMessage, BagMessages
    from ..messages.ros_types import Typestore
    from ..model.channels import Channel
    from ..model.samples import Int64Array
    from ..options.selection import Bound, SelectionOptions
    from .bag_topics import ImageMaker

_SCAN = 'sensor_msgs/msg/PointCloud2'
_OF_CAMERA = frozenset(
    {'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/CameraInfo'}
)


class BagProgram:
    """The messages of a bag, and images made from them; for one fetching thread at a time.

    Frames of a bag written by to-bag have KITTI's numbers. In other bags a frame is what is nearest
    to a message of the reference topic: the first with point clouds, else that of a camera, else
    the one with most messages; frames count from 0.

    Args:
        path: An .mcap, .db3 or .bag file, or a rosbag2 directory.
        selection: Topics, and the first and last moment, both included.
        reserved: Maps a topic and its type to the reason why the player itself publishes that
            topic, or to an empty string; the bag's messages of a reserved topic are skipped.
        images: Makes image topics that the bag does not contain.

    Raises:
        BadBagError: The bag cannot be read.
        UsageError: The selection matches no message, or names streams.
    """

    workers = 1

    def __init__(
        self,
        path: Path,
        selection: SelectionOptions,
        reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
        images: ImageMaker | None = None,
    ) -> None:
        if selection.streams:
            raise UsageError('a bag has topics, no streams; choose by topics')
        self._path = path
        bag_index = index_bag(path)
        stamps = bag_index.by_topic()
        self._images = images or AsItIs()
        counts = {key: sum(map(len, found)) for key, found in bag_index.stamps.items()}
        played = choose_topics(path, counts, selection.topics, reserved, self._images)
        self._notes = played.notes
        wanted = played.read if {*played.names} == {*selection.topics} else None
        self.name = path.name
        # An unreadable topic is an error only if it is selected by its full name.
        with open_messages(path, wanted) as messages:
            # The index also counts messages that are not CDR.
            read = {topic for topic, _ in messages.channels if len(stamps.get(topic, ()))}
            self._topics = frozenset(read & played.read)
            if not self._topics:
                raise BadBagError(path, 'holds no message of these topics', 'one at least')
            self.typestore: Typestore = messages.typestore
            self.losses = tuple(dict.fromkeys((*bag_index.findings, *messages.findings)))
            self.channels: Sequence[Channel] = played.channels(messages, self._topics)
        self._index = {outlet.topic: index for index, outlet in enumerate(self.channels)}
        self._made = played.made(self.channels)
        if self._made:
            define_images(self.typestore)
        self._numbered = number_bag(path, stamps)
        self.stamps_ns, self.frames = self._select(selection, stamps)
        self._latched = self._read_latched(int(self.stamps_ns[-1]))
        self._messages: BagMessages | None = None
        self._iterator: Iterator[BagMessage] | None = None
        self._next = 0

    def _select(
        self, selection: SelectionOptions, stamps: Mapping[str, Int64Array]
    ) -> tuple[Int64Array, Int64Array]:
        """Return the ascending stamps and the frames of the selected messages, (N,) each.

        Raises:
            UsageError: The selection matches none.
        """
        every = np.sort(np.concatenate([stamps[topic] for topic in self._topics]))
        own = self._own_frames(every, stamps)
        begin = min(int(found[0]) for found in stamps.values() if len(found))
        start, end = selection.start, selection.end
        first, last = (
            _bound_ns(bound, every, own, (begin, side)) for side, bound in enumerate((start, end))
        )
        span = slice(*np.searchsorted(every, [first, last + 1]))
        if start and end and every[0] <= last < first <= every[-1]:
            raise selection.reversed_error()
        if not len(every[span]):
            there = f'{len(every)}; it has frames {own.min()} to {own.max()}'
            raise UsageError(f'{self._path}: the selection takes no message of {there}')
        frames = never_falling(own)[span]
        if end is not None and end.frame is not None:
            # Messages before the last one of a frame are played with that frame.
            frames = np.minimum(frames, end.frame)
        return every[span], frames

    def _own_frames(self, every: Int64Array, stamps: Mapping[str, Int64Array]) -> Int64Array:
        """Return the (N,) frame of each message in order of time; frames may decrease."""
        numbered = self._numbered
        if numbered is None:
            reference = _reference(self._path, stamps)
            return nearest_frames(every, reference, np.arange(len(reference)))
        return numbered.frames_at(every, self._topics)

    def notes(self) -> tuple[str, ...]:
        """See Program."""
        return self._notes if self._numbered is not None else (*self._notes, BY_POSITION)

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        """See Program."""
        try:
            message = self._read(index)
        except (KittiRos2Error, OSError) as error:
            self._iterator = None
            return [], [Loss('', 1, str(error))]
        if message is None or message.stamp_ns != self.stamps_ns[index]:
            self._iterator = None
            return [], [Loss('', 1, self._reason())]
        due = []
        outlet = self._index.get(message.topic)
        if outlet is not None:
            skipped = self.channels[outlet].on_demand and outlet not in wanted
            due.append(_unmade(outlet, message) if skipped else _due(outlet, message))
        made = self._made.get(message.topic, ())
        due += [_unmade(each, message) for each in made if each not in wanted]
        asked = [each for each in made if each in wanted]
        if not asked:
            return due, []
        images, losses = self._make(message, asked)
        return due + images, losses

    def _make(self, message: BagMessage, made: list[int]) -> tuple[list[Message], list[Loss]]:
        """Make the images of some outlets from a message."""
        names = [self.channels[outlet].topic for outlet in made]
        images = self._images.make(message, names, self.typestore)
        due, losses = [], []
        for outlet, name, image in zip(made, names, images, strict=True):
            if isinstance(image, bytes):
                due.append(Message(outlet, message.stamp_ns, (image,)))
            else:
                losses.append(Loss(name, 1, f'{self._path}: {name} cannot be made: {image}'))
        return due, losses

    def latched_before(self, index: int) -> list[Message]:
        """See Program."""
        last: dict[int, list[Message]] = {}
        for message in self._latched:
            if message.stamp_ns >= self.stamps_ns[index]:
                break
            have = last.setdefault(message.channel, [])
            if have and have[0].stamp_ns != message.stamp_ns:
                have.clear()
            have.append(message)
        return [message for messages in last.values() for message in messages]

    def close(self) -> None:
        """Release the files; another thread may have opened them."""
        self._iterator = self._messages = None

    def _read(self, index: int) -> BagMessage | None:
        """Read the message at a position; seek in the bag if it is not the next one."""
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
        """Return the reason why a message that the index lists cannot be read."""
        findings = self._messages.findings if self._messages is not None else ()
        new = [finding for finding in findings if finding not in self.losses]
        return new[-1] if new else f'{self._path}: contains fewer messages than its index lists'

    def _read_latched(self, last_ns: int) -> list[Message]:
        topics = [outlet.topic for outlet in self.channels if outlet.latched]
        if not topics:
            return []
        with open_messages(self._path, topics) as messages:
            return [
                _due(self._index[message.topic], message)
                for message in messages
                if message.stamp_ns <= last_ns
            ]


def _unmade(outlet: int, message: BagMessage) -> Message:
    """Return a message without data, for an outlet without subscribers."""
    return Message(outlet, message.stamp_ns, ())


def _due(outlet: int, message: BagMessage) -> Message:
    data = bytes(message.data)
    return Message(outlet, message.stamp_ns, (data + filling(len(data)),))


def _reference(path: Path, stamps: Mapping[str, Int64Array]) -> Int64Array:
    """Return the times of the frames: the stamps of the reference topic.

    Scans written by to-bag and stamped at their start count as half-way to facing forward.
    """
    with open_messages(path) as messages:
        channels = [each for each in messages.channels if len(stamps.get(each[0], ()))]
    scans = [topic for topic, msgtype in channels if msgtype == _SCAN]
    cameras = [topic for topic, msgtype in channels if msgtype in _OF_CAMERA]
    candidates = scans[:1] or cameras or [topic for topic, _ in channels]
    chosen = stamps[max(candidates, key=lambda topic: len(stamps[topic]))]
    # Images follow when the scanner faces forward: the mean of both is the middle of a frame.
    return chosen + read_lead_ns(path) // 2 if scans else chosen


def _bound_ns(bound: Bound | None, every: Int64Array, own: Int64Array, end: tuple[int, int]) -> int:
    """Return the first (side 0) or last (side 1) stamp within a bound.

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
