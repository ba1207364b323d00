# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of a bag in one pass over its messages."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ..bags.bag_files import OpenBag
from ..bags.container_file import StoredChannel
from ..bags.locate import METADATA, metadata_bytes
from ..bags.reader import BagMessages, Decoder
from ..bags.stored_messages import ros1_to_cdr, ros_channel
from ..messages.cdr import peek_header, stamp_ns_of
from ..messages.images import size_of
from ..messages.naming import RECORDING, BagContext
from ..messages.tf_tree import FrameTree, LinkTally
from ..messages.topics import decoders
from ..messages.videos import NO_PYAV, VideoDecoder, begins_video, is_video
from ..model.bag_formats import CAMERA_INFO, PICTURES, STRING, TF_TYPES, VIDEOS
from ..model.errors import BadBagError, KittiRos2Error
from ..model.streams import NS_PER_S, Layout
from ..model.yaml_text import load_yaml
from .bag_rules import (
    BAG_RULES,
    CHECKED_TYPES,
    HEADED_TYPES,
    MESSAGE_RULES,
    TOPIC_RULES,
    BagFacts,
    CheckedMessage,
    TopicTrack,
)
from .rule import SOURCE_RULES, CheckedSource, Unopened, find_breaches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from ..bags.container_file import BagIndex
    from ..bags.reader import BagMessage
    from ..messages.ros_types import Typestore
    from ..options.read import ValidateOptions
    from .rule import FindingTally


# The topics and times in a bag's metadata.yaml, compared with its files.

_ROUNDED_NS = NS_PER_S // 1000


def find_differences(path: Path, index: BagIndex) -> list[str]:
    """Compare metadata.yaml with the index of the files; other rules report a damaged one.

    Args:
        path: The bag.
        index: The index of its files.

    Returns:
        Lines that begin with the path of metadata.yaml.
    """
    source = path / METADATA
    try:
        information = load_yaml(metadata_bytes(path))['rosbag2_bagfile_information']
        differences = [*_compare_topics(information, index), *_compare_times(information, index)]
    except (OSError, LookupError, TypeError, ValueError):
        return []
    return [f'{source}: {difference}' for difference in differences]


def _compare_topics(information: dict[str, Any], index: BagIndex) -> Iterator[str]:
    counts = {key: sum(map(len, chunks)) for key, chunks in index.stamps.items()}
    types = dict(counts.keys())
    for entry in information.get('topics_with_message_count') or ():
        described = entry['topic_metadata']
        topic, msgtype = str(described['name']), str(described['type'])
        listed = int(entry['message_count'])
        encoding = str(described.get('serialization_format') or 'cdr')
        read_as = ros_channel(StoredChannel(topic, msgtype, encoding)).msgtype
        count = counts.get((topic, types.get(topic, '')), 0)
        if topic in types and types[topic] not in {msgtype, read_as}:
            yield f'{topic} is {msgtype} here, {types[topic]} in the files'
        if topic in types and listed != count:
            yield f'{topic} has {listed} messages here, {count} in the files'


def _compare_times(information: dict[str, Any], index: BagIndex) -> Iterator[str]:
    stamps = [chunk for chunks in index.stamps.values() for chunk in chunks if len(chunk)]
    if not stamps:
        return
    first, last = (
        min(int(stamp.min()) for stamp in stamps),
        max(int(stamp.max()) for stamp in stamps),
    )
    start = int(information['starting_time']['nanoseconds_since_epoch'])
    duration = int(information['duration']['nanoseconds'])
    if abs(start - first) > _ROUNDED_NS:
        yield f'the bag begins at {start} here, at {first} in the files'
    if abs(duration - (last - first)) > _ROUNDED_NS:
        yield f'the bag lasts {duration} ns here, {last - first} ns in the files'


def check_bag(
    path: Path,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Callable[[int, int], None],
) -> CheckedSource:
    """Check a bag.

    Args:
        path: A file or folder.
        options: Options of the checks.
        tally: Collects the breaches.
        progress: Called with the messages done and expected.
    """
    try:
        with OpenBag(path, whole_chunks=True) as bag:
            return _BagPass(bag, options, tally).run(progress)
    except (KittiRos2Error, OSError) as error:
        tally.add(find_breaches(SOURCE_RULES, Unopened(path, error)))
        return CheckedSource(path, 'bag', path.name, 0, 0, 0, is_bag=True)


class _BagPass:
    """One pass over an open bag."""

    def __init__(self, bag: OpenBag, options: ValidateOptions, tally: FindingTally) -> None:
        self._bag = bag
        self._options = options
        self._tally = tally
        self._facts = BagFacts(bag.path)
        self._tracks: dict[str, TopicTrack] = {}
        self._links = LinkTally()
        self._videos: dict[str, VideoDecoder[int]] = {}
        self._unchecked: set[str] = set()

    def run(self, progress: Callable[[int, int], None]) -> CheckedSource:
        """Read the bag, and apply the rules."""
        located = self._bag.located
        try:
            # As stored: only checked messages of ROS 1 are converted.
            with BagMessages([self._bag], as_stored=True, as_ros=True) as messages:
                if not self._options.quick:
                    self._read(messages, progress)
                self._facts.left_out = [loss.message for _, loss in messages.left_out]
                self._facts.losses = [
                    loss for loss in messages.losses if loss not in self._facts.left_out
                ]
                self._facts.notes = [
                    problem for problem in messages.problems if problem not in messages.losses
                ]
        except BadBagError as error:  # all of its messages are unreadable
            self._facts.left_out = [str(error)]
        index = self._bag.index
        reported = {*self._facts.losses, *self._facts.notes, *self._facts.left_out}
        self._facts.notes = [
            *self._facts.notes,
            *(problem for problem in index.problems if problem not in reported),
            *find_differences(self._bag.path, index),
            *(f'{topic}: frames are not checked: {NO_PYAV}' for topic in sorted(self._unchecked)),
        ]
        self._facts.messages = index.total
        static, moving, changing = self._links.sorted()
        if static or moving:
            self._facts.tree = FrameTree(static, moving)
            self._facts.changing = changing
        for track in self._tracks.values():
            self._tally.add(find_breaches(TOPIC_RULES, track))
        self._tally.add(find_breaches(BAG_RULES, self._facts))
        size = sum(file.stat().st_size for file in located.files)
        name = self._bag.path.name
        count = len(located.files)
        return CheckedSource(
            self._bag.path, located.container, name, index.total, count, size, is_bag=True
        )

    def _read(self, messages: BagMessages, progress: Callable[[int, int], None]) -> None:
        decode = Decoder(messages.typestore, lent=True)
        expected = messages.expected
        for done, message in enumerate(messages, 1):
            track = self._tracks.get(message.topic)
            if track is None:
                latched = message.topic in messages.latched
                profiles = messages.sources[message.topic].profiles
                track = TopicTrack(self._bag.path, message.topic, latched, profiles)
                self._tracks[message.topic] = track
            track.log_ns.append(message.stamp_ns)
            if message.msgtype in CHECKED_TYPES:
                is_ros1 = messages.sources[message.topic].encoding == 'ros1'
                self._check(message, decode, messages.typestore if is_ros1 else None)
            progress(done, expected)
        for topic, decoder in self._videos.items():
            self._enter_images(topic, decoder.rest())

    def _enter_header(self, message: BagMessage) -> None:
        try:
            stamp_ns, frame = peek_header(message.data)
        except ValueError:
            return  # not decodable either
        self._tracks[message.topic].header_ns.append(stamp_ns)
        self._facts.frames.setdefault(frame.lstrip('/'), message.topic)

    def _check(self, message: BagMessage, decode: Decoder, ros1: Typestore | None) -> None:
        value, error = None, ''
        try:
            if ros1 is not None:
                message = message._replace(data=ros1_to_cdr(ros1, message.data, message.msgtype))
            if message.msgtype in HEADED_TYPES:
                self._enter_header(message)
            value = decode(message)
        except Exception as failure:  # noqa: BLE001 - converters may raise anything
            error = ' '.join(str(failure).split())
        checked = CheckedMessage(
            self._bag.path,
            message.topic,
            message.msgtype,
            message.stamp_ns,
            value,
            error,
            self._options.decode,
        )
        self._tally.add(find_breaches(MESSAGE_RULES, checked))
        if value is not None:
            self._enter(message, value)

    def _enter(self, message: BagMessage, value: Any) -> None:  # noqa: ANN401 - of the bag's types
        if message.msgtype in TF_TYPES:
            self._links.add(value, still=message.topic.endswith('tf_static'))
        elif message.msgtype == CAMERA_INFO:
            size = int(value.width), int(value.height)
            self._facts.sizes.add_info(message.topic, stamp_ns_of(value.header), size)
        elif message.msgtype in PICTURES | VIDEOS and is_video(value):
            self._enter_packet(message, value)
        elif message.msgtype in PICTURES:
            image_size = size_of(value)
            if image_size is not None:
                self._facts.sizes.add_image(message.topic, stamp_ns_of(value.header), image_size)
        elif message.topic == RECORDING and message.msgtype == STRING:
            with suppress(KittiRos2Error, ValueError, LookupError):  # to-kitti reports the error
                described = decoders()[RECORDING](value, BagContext(self._bag.path))
                layout = Layout(described.values['layout'])
                self._facts.per_frame = layout.traits.calibration_per_frame

    def _enter_packet(self, message: BagMessage, packet: Any) -> None:  # noqa: ANN401 - as _enter
        track = self._tracks[message.topic]
        try:
            begins = begins_video(packet, surely=False)
        except ValueError:  # image-layout
            return
        if message.topic not in self._videos:
            track.unbegun = (track.unbegun or 0) + (not begins)
            if not begins:
                return
        decoder = self._videos.setdefault(message.topic, VideoDecoder())
        if self._options.decode:
            self._enter_images(message.topic, decoder.feed(message.stamp_ns, packet))

    def _enter_images(self, topic: str, images: Iterable[tuple[int, Any]]) -> None:
        for stamp_ns, image in images:
            if not isinstance(image, ValueError):
                continue
            if str(image) == NO_PYAV:
                self._unchecked.add(topic)
            else:
                self._tracks[topic].undecoded[str(image)].append(stamp_ns)
