# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Camera images of a bag of to-bag that another program has encoded anew since.

As video, or as PNG, JPEG or WebP on a topic of pixels; or as pixels on a topic of files.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from ..files.image_files import JPEG_SIGNATURE, encode_png
from ..importer.bag_videos import BagVideos
from ..importer.survey import survey_bags
from ..messages.images import as_grey, pixels_of, size_of
from ..messages.topics import own_topics
from ..messages.videos import is_made_even, scaled_to_odd
from ..model.bag_formats import CAMERA_INFO, COMPRESSED_VIDEO, PICTURES, VIDEOS
from ..model.samples import Image
from ..model.streams import GREY_CAMERAS, PngForm

if TYPE_CHECKING:
    from collections.abc import Collection
    from typing import Any

    from ..bags.bag_files import OpenBag
    from ..importer.survey import Survey


def _is_reencoded(topic: str, msgtype: str) -> bool:
    """Return whether an image topic of to-bag has another type of images or of videos."""
    row = own_topics().get(topic)
    if row is None or row.decode is None or row.msgtype not in PICTURES:
        return False
    return msgtype in (PICTURES | VIDEOS) - {row.msgtype}


def open_reencoded(bag: OpenBag, channels: Collection[tuple[str, str]]) -> ReencodedImages | None:
    """Survey the images that are encoded anew among the topics of a bag; None without any.

    Args:
        bag: The bag.
        channels: Topics to read, and their types.

    Raises:
        BadBagError: It cannot be read.
    """
    images = {topic for topic, msgtype in channels if _is_reencoded(topic, msgtype)}
    if not images:
        return None
    topics = bag.index.by_topic()
    infos = {info for topic in images if (info := _info_of(topic)) in topics}
    return ReencodedImages(survey_bags([bag], images | infos))


class ReencodedImages:
    """The images of a bag of to-bag that are encoded anew.

    Args:
        survey: The survey of the bag, of these topics and those of their CameraInfo.

    Attributes:
        videos: Decodes those that are videos in order.
    """

    def __init__(self, survey: Survey) -> None:
        self._survey = survey
        self.videos = BagVideos(
            survey,
            {
                topic.name: range(topic.count)
                for topic in survey.topics.values()
                if topic.keys is not None
            },
        )

    def __contains__(self, topic: str) -> bool:
        """Return whether the images of a topic are encoded anew."""
        surveyed = self._survey.topics.get(topic)
        return surveyed is not None and _is_reencoded(
            topic, COMPRESSED_VIDEO if topic in self.videos else surveyed.msgtype
        )

    def file(
        self,
        topic: str,
        stamp_ns: int,
        message: Any,  # noqa: ANN401 - of the bag's types
        form: PngForm = PngForm.FAST,
    ) -> Image:
        """Return an image as a PNG, of the size of the CameraInfo with its stamp.

        Raises:
            ValueError: It cannot be decoded.
        """
        pixels = pixels_of(message)
        size = self._camera_size(topic, stamp_ns)
        scaled = None if size is None else scaled_to_odd(pixels, size)
        pixels = pixels if scaled is None else scaled
        if own_topics()[topic].stream.camera in GREY_CAMERAS:
            pixels = as_grey(pixels)
        height, width = pixels.shape[:2]
        return Image(encode_png(pixels, form), width, height, 1 if pixels.ndim == 2 else 3)

    def change(self, topic: str, stamp_ns: int, message: Any) -> str:  # noqa: ANN401
        """Describe how an image surely differs from KITTI's; '' where its bytes may tell."""
        texts = []
        if topic in self.videos:
            texts.append('decoded from video')
        elif message.data[: len(JPEG_SIGNATURE)].tobytes() == JPEG_SIGNATURE:
            texts.append('decoded from JPEG')
        own, camera = size_of(message), self._camera_size(topic, stamp_ns)
        if own is not None and camera is not None and own != camera:
            pixels = '{} x {} pixels'.format(*own)
            if not is_made_even(own, camera):
                texts.append('of {}, and its camera has {} x {}'.format(pixels, *camera))
            elif not texts:
                texts.append(f'scaled from {pixels}')
        return f"{', '.join(texts)}: not KITTI's own pixels" if texts else ''

    def _camera_size(self, topic: str, stamp_ns: int) -> tuple[int, int] | None:
        """Return width and height in the CameraInfo that is valid at a stamp; None without one."""
        info = self._survey.topics.get(_info_of(topic))
        if info is None or info.msgtype != CAMERA_INFO or not info.contents:
            return None
        last = bisect_right(info.header_ns, stamp_ns) - 1
        valid = max(bisect_right([index for index, _ in info.contents], last) - 1, 0)
        _, camera = info.contents[valid]
        return int(camera.width), int(camera.height)


def _info_of(topic: str) -> str:
    """Return the CameraInfo topic beside an image topic of to-bag."""
    return f'{topic.removesuffix("/compressed").rpartition("/")[0]}/camera_info'
