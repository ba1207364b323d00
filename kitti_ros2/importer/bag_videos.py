# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The videos of a bag, decoded in order of reading for a conversion, or from a key frame for one.

A survey has the indices of the messages at which decoding can begin. Frames may refer to the key
frame before that (open groups of H.265), so a part of a video is decoded from there.
"""

from __future__ import annotations

from bisect import bisect_right
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..bags.single_messages import positions_of
from ..messages.videos import VideoDecoder

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

    from ..bags.reader import BagMessage, Decoder
    from ..bags.single_messages import MessagesByPosition
    from ..messages.ros_types import ImageMsg
    from .survey import Survey, TopicSurvey

if TYPE_CHECKING:
    Outcome: TypeAlias = tuple[int, BagMessage, ImageMsg | ValueError]


def needed_for(topic: TopicSurvey, index: int) -> range:
    """Return the indices of the messages of a topic that one of its images is decoded from."""
    return range(index if topic.keys is None else first_needed(topic.keys, index), index + 1)


def first_needed(keys: Sequence[int], index: int) -> int:
    """Return the index of the first message to decode for the image of another one."""
    before = bisect_right(keys, index)
    return keys[before - 2] if before > 1 else 0


class BagVideos:
    """Decodes the video topics of a conversion; for one thread at a time.

    Args:
        survey: The survey of the bags.
        needed: The indices of the requested images, by topic; other topics than videos are ignored.
    """

    def __init__(self, survey: Survey, needed: Mapping[str, Collection[int]]) -> None:
        self._keys: dict[str, Sequence[int]] = {}
        self._groups: dict[str, set[int]] = {}
        for topic, indices in needed.items():
            keys = survey.topics[topic].keys if topic in survey.topics else None
            if keys is not None:
                self._keys[topic] = keys
                groups = {bisect_right(keys, index) for index in indices}
                self._groups[topic] = groups | {group - 1 for group in groups}
        self._decoders = {topic: VideoDecoder[tuple[int, 'BagMessage']]() for topic in self._keys}
        self._next = dict.fromkeys(self._keys, 0)

    def __contains__(self, topic: str) -> bool:
        """Return whether a topic is a video."""
        return topic in self._keys

    def take(self, index: int, message: BagMessage, decode: Decoder) -> Iterator[Outcome]:
        """Decode a message of a video by its index; yield the images decoded so far.

        They are not in order where frames are held back. Messages that no image needs are skipped.
        """
        topic = message.topic
        if bisect_right(self._keys[topic], index) not in self._groups[topic]:
            return
        decoder = self._decoders[topic]
        if index != self._next[topic]:
            yield from self._outcomes(decoder.rest())
        self._next[topic] = index + 1
        head = message._replace(data=b'')
        try:
            packet = decode(message)
        except ValueError as error:
            yield index, head, error
            return
        yield from self._outcomes(decoder.feed((index, head), packet))

    def rest(self) -> Iterator[Outcome]:
        """Yield the images that are held back at the end."""
        for decoder in self._decoders.values():
            yield from self._outcomes(decoder.rest())

    def notes(self) -> list[str]:
        """Return notes on the videos so far."""
        return [
            f'{topic}: {decoder.beyond_range} images have luma beyond the limited range of video,'
            f' and no flag of the full range: their contrast is too high if the encoder meant that'
            f' (pymcap-cli 0.34 does for PNG and JPEG)'
            for topic, decoder in self._decoders.items()
            if decoder.beyond_range
        ]

    def _outcomes(self, images: Any) -> Iterator[Outcome]:  # noqa: ANN401 - of VideoDecoder
        for (index, head), image in images:
            yield index, head, image


def open_video(topic: TopicSurvey, messages: MessagesByPosition) -> VideoImages:
    """Return the images of a video topic, read from a bag by the positions of its messages."""
    log_ns = np.array(topic.log_ns, dtype=np.int64)

    def read(index: int) -> Any:  # noqa: ANN401 - of the bag's types
        (position,) = positions_of(topic.name, log_ns, [index])
        return messages.read(position)

    return VideoImages(topic.keys or (), topic.count, read)


_MOST_AHEAD = 32
_CACHED_BYTES = 2**26
"""Of images around the one read last: threads read them in any order."""


class VideoImages:
    """The images of a video topic by index; thread-safe.

    Args:
        keys: The indices at which decoding can begin.
        count: The number of its messages.
        read: Reads and decodes a message by its index.
    """

    def __init__(self, keys: Sequence[int], count: int, read: Callable[[int], Any]) -> None:
        self._keys = keys
        self._count = count
        self._read = read
        self._decoder: VideoDecoder[int] = VideoDecoder()
        self._next = 0
        self._images: dict[int, ImageMsg | ValueError] = {}
        self._lock = Lock()

    def image(self, index: int) -> ImageMsg:
        """Return the image of a message.

        Raises:
            Exception: It cannot be read or decoded.
        """
        with self._lock:
            if index not in self._images:
                self._decode(index)
            image = self._images[index]
        if isinstance(image, ValueError):
            raise image
        return image

    def _decode(self, index: int) -> None:
        start = first_needed(self._keys, index)
        if not start < self._next <= index:
            self._decoder, self._next = VideoDecoder(), start
        while index not in self._images and self._next < min(index + _MOST_AHEAD, self._count):
            number, self._next = self._next, self._next + 1
            self._keep(self._decoder.feed(number, self._read(number)), index)
        if index not in self._images:
            self._keep(self._decoder.rest(), index)
            self._next = self._count

    def _keep(self, images: list[tuple[int, ImageMsg | ValueError]], index: int) -> None:
        """Keep images, and forget the oldest, not that of an index."""
        for number, image in images:
            self._images[number] = image
        sizes = {
            number: 0 if isinstance(image, ValueError) else len(image.data)
            for number, image in self._images.items()
        }
        for number in sizes:
            if sum(sizes[kept] for kept in self._images) <= _CACHED_BYTES:
                return
            if number != index:
                del self._images[number]
