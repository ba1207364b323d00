# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Camera images of a bag of to-bag that another program has encoded as video since."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from ..files.image_files import encode_png
from ..importer.bag_videos import BagVideos
from ..importer.survey import survey_bags
from ..messages.images import decode_pixels
from ..messages.videos import scaled_to_odd
from ..model.bag_formats import CAMERA_INFO, VIDEOS
from ..model.samples import Image

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..bags.bag_files import OpenBag
    from ..importer.survey import Survey
    from ..messages.ros_types import ImageMsg


def open_videos(bag: OpenBag, channels: Collection[tuple[str, str]]) -> ReencodedImages | None:
    """Survey the videos among the topics of a bag; None without any.

    Args:
        bag: The bag.
        channels: Topics to read, and their types.

    Raises:
        BadBagError: It cannot be read.
    """
    videos = {topic for topic, msgtype in channels if msgtype in VIDEOS}
    if not videos:
        return None
    topics = bag.index.by_topic()
    infos = {info for topic in videos if (info := _info_of(topic)) in topics}
    return ReencodedImages(survey_bags([bag], videos | infos))


class ReencodedImages:
    """The videos of a bag of to-bag.

    Args:
        survey: The survey of the bag, of these topics and those of their CameraInfo.

    Attributes:
        videos: Decodes them in order.
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

    def file(self, topic: str, stamp_ns: int, message: ImageMsg) -> Image:
        """Return an image as a PNG, of the size of the CameraInfo with its stamp."""
        pixels = decode_pixels(message)
        info = self._survey.topics.get(_info_of(topic))
        if info is not None and info.msgtype == CAMERA_INFO and info.contents:
            last = bisect_right(info.header_ns, stamp_ns) - 1
            valid = max(bisect_right([index for index, _ in info.contents], last) - 1, 0)
            _, camera = info.contents[valid]
            scaled = scaled_to_odd(pixels, (int(camera.width), int(camera.height)))
            pixels = pixels if scaled is None else scaled
        height, width = pixels.shape[:2]
        return Image(encode_png(pixels), width, height, 1 if pixels.ndim == 2 else 3)


def _info_of(topic: str) -> str:
    """Return the CameraInfo topic beside an image topic of to-bag."""
    return f'{topic.removesuffix("/compressed").rpartition("/")[0]}/camera_info'
