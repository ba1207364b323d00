# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The programs of a player: opened from a KITTI folder or a bag; that of a bag, and its images."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bags.bag_files import OpenBag, opened
from ..bags.open_source import open_source
from ..bags.reader import Decoder, open_messages, read_earlier_losses, read_lead_ns
from ..bags.single_messages import MessagesByIndex
from ..files.remote import as_path
from ..files.threads import worker_count
from ..kitti.extract_oxts import add_extract
from ..kitti.prepare import add_predictions
from ..messages.cdr import Message, filling, join, serialize, stamp_ns_of
from ..messages.images import encode_pixels, pixels_of
from ..messages.ros_types import TYPESTORE
from ..messages.topics import match_names, unmatched, view_topics
from ..model.bag_formats import (
    ANNOTATIONS,
    CAMERA_INFO,
    CLOUD,
    COMPRESSED,
    DIAGNOSTICS,
    HEADER,
    IMAGE,
    VIDEOS,
    Channel,
)
from ..model.errors import BadBagError, KittiRos2Error, Loss, UsageError, describe_error
from ..model.recording import BY_POSITION
from ..model.streams import Stream
from ..options.messages import ColorEncoding, Fisheye, Images
from ..options.outputs import Stamps
from ..options.table import PlaySettings
from ..own_bags.numbering import number_bag
from ..own_bags.schedule import describe_extent, frame_runs, nearest_frames
from .program import RecordingProgram, longest_gap_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import BagSource
    from ..bags.reader import BagMessage, BagMessages
    from ..importer.labelled_images import LabelledImages
    from ..messages.images import Pixels
    from ..messages.ros_types import Typestore
    from ..model.samples import Int64Array
    from ..options.messages import MessageOptions
    from ..options.read import Bound, SelectionOptions
    from ..options.table import Settings
    from .program import Program


# Selection of the topics of a bag to play, and of the image topics made from them.

_OF_IMAGE = (IMAGE, HEADER, 'builtin_interfaces/msg/Time')
_DEPTH = 10


@dataclass(frozen=True)
class ImageTopics:
    """Image topics played in addition to those of a bag, or instead.

    Attributes:
        sources: Made topic to the topic of the bag that it is made from.
        hidden: Topics of the bag that are not played.
        notes: Remarks for the user, one line each.
    """

    sources: Mapping[str, str] = field(default_factory=dict)
    hidden: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlayedTopics:
    """The topics of a bag to play.

    Attributes:
        names: The topics, including made ones.
        sources: See ImageTopics.
        notes: Remarks for the user, one line each.
    """

    names: tuple[str, ...]
    sources: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def read(self) -> frozenset[str]:
        """The topics to read from the bag."""
        return frozenset(self.sources.get(name, name) for name in self.names)

    def channels(self, messages: BagMessages, counts: Mapping[str, int]) -> list[Channel]:
        """Return the channels of the topics.

        A latched one queues the messages of one round at most: a deeper queue would fill with
        copies when the bag is repeated.

        Args:
            messages: The bag.
            counts: The readable topics of the bag, with their numbers of messages.
        """
        own = [
            Channel(
                topic,
                msgtype,
                latched=topic in messages.latched,
                depth=min(messages.latched[topic], counts[topic])
                if topic in messages.latched
                else _DEPTH,
            )
            for topic, msgtype in messages.channels
            if topic in counts and topic in self.names
        ]
        return own + [
            Channel(name, IMAGE, depth=_DEPTH)
            for name in self.names
            if self.sources.get(name) in counts
        ]

    def made(self, channels: Sequence[Channel]) -> dict[str, list[int]]:
        """Map topics of the bag to the indices of the channels made from them."""
        outlets: dict[str, list[int]] = {}
        for index, channel in enumerate(channels):
            if channel.topic in self.sources:
                outlets.setdefault(self.sources[channel.topic], []).append(index)
        return outlets


def choose_topics(
    path: Path,
    counts: Mapping[tuple[str, str], int],
    selection: SelectionOptions,
    reserved: Callable[[str, str], str],
    image_topics: ImageTopics,
) -> PlayedTopics:
    """Choose the topics of a bag to play.

    Args:
        path: The bag, for error messages.
        counts: Message counts by topic and type.
        selection: Requested topics.
        reserved: Maps a topic and its type to the reason for skipping it, or to an empty string.
        image_topics: Image topics to be made.

    Raises:
        UsageError: The selection matches no topic, or only skipped ones.
    """
    reasons = {key: why for key in counts if (why := reserved(*key))}
    names = {topic for topic, _ in counts} | {*image_topics.sources}
    selected = match_names(sorted(names - image_topics.hidden), selection)
    left_out = tuple(
        f'{path}: {key[0]} is left out, {counts[key]} messages: {why}'
        for key, why in reasons.items()
        if counts[key] and key[0] in selected
    )
    played = tuple(name for name in selected if name not in {topic for topic, _ in reasons})
    if left_out and not played:
        raise UsageError(left_out[0])
    unknown = unmatched(names, selection)
    return PlayedTopics(played, image_topics.sources, (*left_out, *unknown, *image_topics.notes))


def define_images(typestore: Typestore) -> None:
    """Add the definition of sensor_msgs/Image to the types of a bag if it is missing."""
    missing = [name for name in _OF_IMAGE if name not in typestore.fielddefs]
    typestore.register({name: TYPESTORE.fielddefs[name] for name in missing})


# The program of a bag.

_OF_CAMERA = VIDEOS | {IMAGE, COMPRESSED, CAMERA_INFO}


class BagProgram:
    """The messages of a bag, and images made from them; for one fetching thread at a time.

    Frames of a bag written by to-bag have KITTI's numbers. In other bags a frame is what is nearest
    to a message of the reference topic: the first with point clouds, else that of a camera, else
    the one with most messages; frames count from 0.

    Args:
        source: The bag; the program keeps its files open until it is closed.
        selection: Topics, and the first and last time, both included.
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
            counts = {key: sum(map(len, stamps_ns)) for key, stamps_ns in bag.index.stamps.items()}
            image_topics = ImageTopics() if images is None else images.topics(dict(counts.keys()))
            played = choose_topics(bag.path, counts, selection, reserved, image_topics)
            stamps = bag.index.by_topic()
            self._open(bag, played, stamps, exact={*played.names} == {*selection.topics})
            self._numbered = number_bag(bag, stamps)
            self.stamps_ns, self.frames = self._select(bag, selection, stamps)
            own = self._numbered
            self.longest_gap_ns = own and longest_gap_ns(own.source_files.layout, own.clock)
            self._latched = self._read_latched(bag)
            self._messages: BagMessages = open_messages(bag, self._topics)
        self._by_index = MessagesByIndex(self._messages, self.stamps_ns)

    def _open(
        self,
        bag: OpenBag,
        played: PlayedTopics,
        stamps: Mapping[str, Int64Array],
        *,
        exact: bool,
    ) -> None:
        """Set topics, types, losses, notes and outlets.

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
            self.losses = tuple(dict.fromkeys((*bag.index.losses, *messages.losses)))
            earlier = read_earlier_losses(bag, self._topics)
            problems = dict.fromkeys((*bag.index.problems, *messages.problems, *earlier))
            self._notes = (*played.notes, *(line for line in problems if line not in self.losses))
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
        begin = min(int(stamps_ns[0]) for stamps_ns in stamps.values() if len(stamps_ns))
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
        numbered = self._numbered
        if by_frame and numbered is not None and numbered.source_files.times is not None:
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
            message = self._by_index.read(index)
        except (KittiRos2Error, OSError) as error:
            return [], [Loss('', 1, describe_error(error))]
        if message is None:
            return [], [Loss('', 1, self._reason())]
        due = []
        outlet = self._index.get(message.topic)
        if outlet is not None:
            skipped = self.channels[outlet].on_demand and outlet not in wanted
            due.append(_unmade(outlet, message) if skipped else _due(outlet, message))
        outlets = self._made.get(message.topic, ())
        due += [_unmade(channel, message) for channel in outlets if channel not in wanted]
        images, losses = self._make(message, [channel for channel in outlets if channel in wanted])
        return due + images, losses

    def _make(self, message: BagMessage, outlets: list[int]) -> tuple[list[Message], list[Loss]]:
        """Make the images of some outlets from a message."""
        if self._images is None or not outlets:
            return [], []
        names = [self.channels[outlet].topic for outlet in outlets]
        images = self._images.make(message, names, self.typestore)
        due, losses = [], []
        for outlet, name, image in zip(outlets, names, images, strict=True):
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

    def _reason(self) -> str:
        """Return the reason why a message that the index lists cannot be read."""
        new = [problem for problem in self._messages.losses if problem not in self.losses]
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
    parts = (message.data, filling(len(message.data)))
    return Message(outlet, message.stamp_ns, (b''.join(parts) if parts[1] else bytes(parts[0]),))


def _frames_by_position(
    bag: OpenBag, every: Int64Array, stamps: Mapping[str, Int64Array]
) -> Int64Array:
    """Return the (N,) frame of each of (N,) stamps: what is nearest in the reference topic.

    Scans written by to-bag and stamped at their start count as half-way to facing forward.
    """
    with open_messages(bag) as messages:
        channels = [channel for channel in messages.channels if len(stamps.get(channel[0], ()))]
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
        indices = np.flatnonzero(own <= frame)
        return int(every[indices[-1]]) if len(indices) else int(every[0]) - 1
    indices = np.flatnonzero(own >= frame)
    return int(every[indices[0]]) if len(indices) else int(every[-1]) + 1


# Decoded and annotated sensor_msgs/Image topics, made from the images of a bag.
#
# By the convention of image_transport, IMAGE/compressed is the CompressedImage of the Image IMAGE.
# A topic with another name is decoded to TOPIC/raw.

_SUFFIX = '/compressed'
_DEPTH_SUFFIX = '/compressedDepth'


class BagImages:
    """Makes the image topics that the message options request; for one thread at a time.

    Args:
        bag: The bag; its files are open until close.
        options: images, annotated and color_encoding.

    Raises:
        UsageError: Annotated images are requested, but the data they need is missing from the bag.
    """

    def __init__(self, bag: OpenBag, options: MessageOptions) -> None:
        self._images = options.images
        self._color = options.color_encoding
        self._labelled: LabelledImages | None = None
        if options.annotated:
            from ..importer.labelled_images import LabelledImages  # noqa: PLC0415 - 0.2 s of OpenCV

            self._labelled = LabelledImages(bag)
        self._annotated: dict[str, str] = {}
        self._decoder: Decoder | None = None

    def topics(self, types: Mapping[str, str]) -> ImageTopics:
        """Choose the topics to make for a bag, given its message types by topic."""
        compressed = sorted(topic for topic, msgtype in types.items() if msgtype == COMPRESSED)
        pictures = [topic for topic in compressed if not topic.endswith(_DEPTH_SUFFIX)]
        decoded = {_decoded_name(topic): topic for topic in pictures}
        notes = [
            f'{topic} is played unchanged: depth images are not decoded'
            for topic in compressed
            if topic not in pictures and self._images is not Images.COMPRESSED
        ]
        there = {name for name in decoded if types.get(name) == IMAGE}
        hidden: set[str] = set()
        if self._images is Images.COMPRESSED:
            hidden, decoded = there, {}
        elif self._images is Images.RAW:
            hidden = set(pictures)
        sources = {name: topic for name, topic in decoded.items() if name not in types}
        if self._labelled is not None:
            names = {_annotated_name(topic): topic for topic in self._labelled.topics}
            self._annotated = {name: topic for name, topic in names.items() if name not in types}
            notes += self._labelled.notes
        return ImageTopics({**sources, **self._annotated}, frozenset(hidden), tuple(notes))

    def make(
        self, message: BagMessage, names: Sequence[str], typestore: Typestore
    ) -> list[bytes | ValueError]:
        """Make the CDR of each of the named topics from a message, or the error."""
        self._decoder = self._decoder or Decoder(typestore, lent=True)
        try:
            image = self._decoder(message)
            pixels = pixels_of(image)
        except ValueError as error:
            return [error] * len(names)
        return [self._made(name, image, pixels, message.stamp_ns) for name in names]

    def close(self) -> None:
        """Close the files."""
        if self._labelled is not None:
            self._labelled.close()

    def _made(self, name: str, image: Any, pixels: Pixels, log_ns: int) -> bytes | ValueError:  # noqa: ANN401 - of the bag's types
        stamp_ns = stamp_ns_of(image.header)
        try:
            if name in self._annotated and self._labelled is not None:
                topic = self._annotated[name]
                pixels = self._labelled.draw(topic, image, pixels, stamp_ns, log_ns)
            color = ColorEncoding.BGR8 if name in self._annotated else self._color
            return join(serialize(encode_pixels(pixels, stamp_ns, image.header.frame_id, color)))
        except ValueError as error:
            return error
        except (struct.error, OverflowError) as error:
            return ValueError(f'a value is out of range for {IMAGE} ({error})')


def _decoded_name(topic: str) -> str:
    """Return the topic of the decoded images of a CompressedImage topic."""
    name = topic.removesuffix(_SUFFIX)
    return name if name not in ('', topic) else f'{topic}/raw'


def _annotated_name(topic: str) -> str:
    """Return the topic of the annotated images: in the camera's namespace, as for a folder."""
    camera, _, _ = topic.removesuffix(_SUFFIX).rpartition('/')
    return f'{camera}/annotated'


# Opens the source of a player: a KITTI folder or a bag.

CLOCK = '/clock'
STATE = '/kitti_player/state'

_MOST_WORKERS = 4


def open_program(
    source: str | Path,
    settings: PlaySettings | Settings,
    reserved: Callable[[str, str], str] = lambda _topic, _msgtype: '',
) -> Program:
    """Open a source.

    Args:
        source: Path of a KITTI folder or a bag; ~ is the home directory.
        settings: Read settings; an explicit layout means a KITTI folder.
        reserved: See BagProgram.

    Raises:
        KittiRos2Error: The source is missing or unreadable, or the selection matches nothing.
        OSError: The same.
    """
    path = as_path(source).expanduser()
    opened = open_source(path, settings.read)
    if isinstance(opened, OpenBag):
        with opened as bag:  # the program keeps its files open until it is closed
            if settings.predictions.path is not None:
                raise UsageError(
                    f'{path}: predictions are for KITTI folders, and this is a bag; to-bag takes'
                    f' them when it makes the bag'
                )
            has_annotations = any(msgtype == ANNOTATIONS for _, msgtype in bag.index.stamps)
            if settings.messages.annotations and not has_annotations:
                raise UsageError(
                    f'{path}: annotations are made of KITTI folders, and this is a bag; to-bag'
                    f' --annotations makes a bag with them'
                )
            has_view = any(topic in view_topics() for topic, _ in bag.index.stamps)
            if settings.messages.fisheye is Fisheye.PINHOLE and not has_view:
                raise UsageError(
                    f'{path}: pinhole views of fisheyes are made of KITTI folders, and this is a'
                    f' bag; to-bag --fisheye pinhole makes a bag with them'
                )
            if settings.imu.path is not None:
                raise UsageError(
                    f'{path}: --imu-from is for raw drives, and this is a bag; to-bag takes it when'
                    f' it makes the bag'
                )
            if settings.messages.stack is not None:
                raise UsageError(
                    f'{path}: a bag is played as it is, and --for is for KITTI folders; to-bag'
                    f' --for makes a bag for a stack'
                )
            playing = isinstance(settings, PlaySettings)
            images = BagImages(bag, settings.messages) if playing else None
            return BagProgram(bag, settings.selection, reserved, images)
    if settings.messages.annotated and Stream.LABELS not in opened.streams:
        raise UsageError(f'{path}: no annotated images can be made: the recording has no labels')
    add_predictions(opened, settings.predictions.path)
    add_extract(opened, settings.imu)
    workers = worker_count(_MOST_WORKERS)
    return RecordingProgram(opened, settings.messages, settings.selection, workers)


def publishes_clock(settings: PlaySettings) -> bool:
    """Return whether a node with these settings publishes the recording's time on /clock."""
    return settings.playback.clock_hz > 0 and settings.stamps is Stamps.ORIGINAL


def reserved_by_viewers(topic: str, msgtype: str) -> str:
    """Return why a bag's topic is skipped when serving viewers: the player publishes its state."""
    recorded = topic.endswith(STATE) and msgtype == DIAGNOSTICS
    return 'the player publishes its own' if recorded or topic == STATE else ''


def reserved_by_node(name: str, settings: PlaySettings) -> Callable[[str, str], str]:
    """Return a function that gives the reason why a node skips a bag's topic.

    Two clocks or two states would contradict each other.

    Args:
        name: The node's name with its namespace.
        settings: The node's settings.
    """

    def reserved(topic: str, msgtype: str) -> str:
        if topic == CLOCK and publishes_clock(settings):
            return 'the player publishes its own; --clock 0 plays those of the bag'
        if topic == CLOCK and settings.stamps is Stamps.NOW:
            return "they contain the recording's time, but the stamps are the current time"
        if topic == f'{name}/state':
            return 'the player publishes its own'
        return reserved_by_viewers(topic, msgtype)

    return reserved


def describe(program: Program) -> str:
    """Describe a program in one line."""
    frames, stamps = program.frames, program.stamps_ns
    return (
        f'{program.name}: frames {frames.min()} to {frames.max()},'
        f' {(stamps[-1] - stamps[0]) / 1e9:.1f} s, {len(program.channels)} topics'
    )
