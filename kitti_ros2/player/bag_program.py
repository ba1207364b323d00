# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The program of a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..bags.forward_stamps import read_lead_ns
from ..bags.reader import open_messages, opened
from ..exporter.schedule import frame_runs, nearest_frames
from ..exporter.window import describe_extent
from ..messages.cdr import Message, filling
from ..model.errors import BadBagError, KittiRos2Error, UsageError, describe_error
from ..model.losses import Loss
from ..model.msgtypes import CAMERA_INFO, CLOUD, COMPRESSED, IMAGE
from ..own_bags.numbering import BY_POSITION, number_bag
from .bag_topics import ImageTopics, choose_topics, define_images
from .program import longest_gap_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from ..bags.reader import BagMessage, BagMessages, BagSource, OpenBag
    from ..messages.ros_types import Typestore
    from ..model.channels import Channel
    from ..model.samples import Int64Array
    from ..options.selection import Bound, SelectionOptions
    from .bag_images import BagImages
    from .bag_topics import PlayedTopics

_OF_CAMERA = frozenset({IMAGE, COMPRESSED, CAMERA_INFO})


class BagProgram:
    """The messages of a bag, and images made from them; for one fetching thread at a time.

    Frames of a bag written by to-bag have KITTI's numbers. In other bags a frame is what is nearest
    to a message of the reference topic: the first with point clouds, else that of a camera, else
    the one with most messages; frames count from 0.

    Args:
        source: The bag; the program keeps its files open until it is closed.
        selection: Topics, and the first and last moment, both included.
        reserved: Maps a topic and its type to the reason why the player itself publishes that
            topic, or to an empty string; the bag's messages of a reserved topic are skipped.
        images: Makes image topics that the bag does not contain; None makes none.

    Raises:
        BadBagError: The bag cannot be read.
        UsageError: The selection matches no message, or names streams.
    """

    workers = 1

    def __init__(
        self,
        source: BagSource,
        selection: SelectionOptions,
        reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
        images: BagImages | None = None,
    ) -> None:
        if selection.streams:
            raise UsageError('a bag has topics, no streams; choose by topics')
        self._images = images
        with opened(source) as bag:
            self._path = bag.path
            self.name = bag.path.name
            counts = {key: sum(map(len, found)) for key, found in bag.index.stamps.items()}
            made = ImageTopics() if images is None else images.topics(dict(counts.keys()))
            played = choose_topics(bag.path, counts, selection, reserved, made)
            self._notes = played.notes
            stamps = bag.index.by_topic()
            self._open(bag, played, stamps, exact={*played.names} == {*selection.topics})
            self._numbered = number_bag(bag, stamps)
            self.stamps_ns, self.frames = self._select(bag, selection, stamps)
            own = self._numbered
            self.longest_gap_ns = own and longest_gap_ns(own.blueprint.layout, own.clock)
            self._latched = self._read_latched(bag)
            self._messages: BagMessages = open_messages(bag, self._topics)
        self._iterator: Iterator[BagMessage] | None = None
        self._next = 0

    def _open(
        self,
        bag: OpenBag,
        played: PlayedTopics,
        stamps: Mapping[str, Int64Array],
        *,
        exact: bool,
    ) -> None:
        """Set topics, types, losses and outlets.

        Raises:
            BadBagError: No topic has messages, or one that is selected by its full name (exact)
                cannot be read.
        """
        with open_messages(bag, played.read if exact else None) as messages:
            # The index also counts messages that are not CDR.
            read = {topic for topic, _ in messages.channels if len(stamps.get(topic, ()))}
            self._topics = frozenset(read & played.read)
            if not self._topics:
                raise BadBagError(bag.path, 'holds no message of these topics', 'one at least')
            self.typestore: Typestore = messages.typestore
            self.losses = tuple(dict.fromkeys((*bag.index.findings, *messages.findings)))
            self.channels: Sequence[Channel] = played.channels(
                messages, {topic: len(stamps[topic]) for topic in self._topics}
            )
        self._index = {outlet.topic: index for index, outlet in enumerate(self.channels)}
        self._made = played.made(self.channels)
        if self._made:
            define_images(self.typestore)

    def _select(
        self, bag: OpenBag, selection: SelectionOptions, stamps: Mapping[str, Int64Array]
    ) -> tuple[Int64Array, Int64Array]:
        """Return the ascending stamps and the frames of the selected messages, (N,) each.

        Raises:
            UsageError: The selection matches none.
        """
        every = np.sort(np.concatenate([stamps[topic] for topic in self._topics]))
        if self._numbered is None:
            own = _frames_by_position(bag, every, stamps)
        else:
            own = self._numbered.frames_at(every, self._topics)
            self._refuse_frames(selection)
        begin = min(int(found[0]) for found in stamps.values() if len(found))
        start, end = selection.start, selection.end
        first, last = (
            _bound_ns(bound, every, own, (begin, side)) for side, bound in enumerate((start, end))
        )
        span = slice(*np.searchsorted(every, [first, last + 1]))
        if start and end and every[0] <= last < first <= every[-1]:
            raise selection.reversed_error()
        if not len(every[span]):
            extent = describe_extent(np.unique(own), every, selection)
            raise UsageError(f'{self._path}: {selection} takes no message; it has {extent}')
        frames = frame_runs(own)[span]
        if end is not None and end.frame is not None:
            # Messages before the last one of a frame are played with that frame.
            frames = np.minimum(frames, end.frame)
        return every[span], frames

    def _refuse_frames(self, selection: SelectionOptions) -> None:
        """Check that the frames from a first to a last one are in one piece of the bag.

        Raises:
            UsageError: They are requested and are not: those of an object set in real time.
        """
        bounds = (selection.start, selection.end)
        by_frame = any(bound is not None and bound.frame is not None for bound in bounds)
        if by_frame and self._numbered is not None and self._numbered.blueprint.times is not None:
            raise UsageError(
                f'{self._path}: its frames are in order of time, not of number; give start and end'
                f" as seconds (3.5s) or times ('2011-09-26 13:02:26')"
            )

    def notes(self) -> tuple[str, ...]:
        """See Program."""
        return self._notes if self._numbered is not None else (*self._notes, BY_POSITION)

    def fetch(self, index: int, wanted: Collection[int]) -> tuple[list[Message], list[Loss]]:
        """See Program."""
        try:
            message = self._read(index)
        except (KittiRos2Error, OSError) as error:
            self._iterator = None
            return [], [Loss('', 1, describe_error(error))]
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
        images, losses = self._make(message, [each for each in made if each in wanted])
        return due + images, losses

    def _make(self, message: BagMessage, made: list[int]) -> tuple[list[Message], list[Loss]]:
        """Make the images of some outlets from a message."""
        if self._images is None or not made:
            return [], []
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
        """Close the files; does nothing if they are closed."""
        self._messages.close()
        if self._images is not None:
            self._images.close()

    def _read(self, index: int) -> BagMessage | None:
        """Read the message at a position; seek in the bag if it is not the next one."""
        if self._iterator is None or index != self._next:
            stamp = self.stamps_ns[index]
            self._iterator = self._messages.since(int(stamp))
            for _ in range(index - int(np.searchsorted(self.stamps_ns, stamp))):
                next(self._iterator, None)
        self._next = index + 1
        return next(self._iterator, None)

    def _reason(self) -> str:
        """Return the reason why a message that the index lists cannot be read."""
        new = [finding for finding in self._messages.findings if finding not in self.losses]
        return new[-1] if new else f'{self._path}: contains fewer messages than its index lists'

    def _read_latched(self, bag: OpenBag) -> list[Message]:
        last_ns = int(self.stamps_ns[-1])
        topics = [outlet.topic for outlet in self.channels if outlet.latched]
        if not topics:
            return []
        with open_messages(bag, topics) as messages:
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


def _frames_by_position(
    bag: OpenBag, every: Int64Array, stamps: Mapping[str, Int64Array]
) -> Int64Array:
    """Return the (N,) frame of each of (N,) stamps: what is nearest in the reference topic.

    Scans written by to-bag and stamped at their start count as half-way to facing forward.
    """
    with open_messages(bag) as messages:
        channels = [each for each in messages.channels if len(stamps.get(each[0], ()))]
    scans = [topic for topic, msgtype in channels if msgtype == CLOUD]
    cameras = [topic for topic, msgtype in channels if msgtype in _OF_CAMERA]
    candidates = scans[:1] or cameras or [topic for topic, _ in channels]
    reference = stamps[max(candidates, key=lambda topic: len(stamps[topic]))]
    if scans:
        # Images follow when the scanner faces forward: the mean of both is the middle of a frame.
        reference = reference + read_lead_ns(bag) // 2
    return nearest_frames(every, reference, np.arange(len(reference)))


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
