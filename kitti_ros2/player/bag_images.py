# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Decoded and annotated sensor_msgs/Image topics, made from the images of a bag.

By the convention of image_transport, IMAGE/compressed is the CompressedImage of the Image IMAGE.
A topic with another name is decoded to TOPIC/raw.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from ..bags.decoding import Decoder
from ..messages.cdr import join, serialize
from ..messages.header import stamp_ns_of
from ..messages.image import encode_pixels
from ..messages.pixels import pixels_of
from ..model.msgtypes import COMPRESSED, IMAGE
from ..options.messages import ColorEncoding, Images
from .bag_topics import ImageTopics

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..bags.reader import BagMessage, OpenBag
    from ..importer.labelled_images import LabelledImages
    from ..messages.pixels import Pixels
    from ..messages.ros_types import Typestore
    from ..options.messages import MessageOptions

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
