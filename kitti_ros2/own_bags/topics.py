# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The topics of bags written by to-bag, for all presets and rigs."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from ..messages.naming import IMAGE_TOPICS
from ..messages.topics import make_table
from ..model.streams import CAMERA_COUNT, CAMERA_NAMES, Stream
from ..options.messages import Images, MessageOptions, Preset

if TYPE_CHECKING:
    from ..messages.topics import Topic

LINES = {'/kitti/source/oxts': Stream.OXTS, '/kitti/source/labels': Stream.LABELS}
"""Topics whose messages are single text files, or parts of one."""


@lru_cache(maxsize=1)
def own_topics() -> dict[str, Topic]:
    """Return all rows that to-bag may write, by topic name."""
    numbered = {index: str(index) for index in range(CAMERA_COUNT)}
    found: dict[str, Topic] = {}
    for preset in Preset:
        options = MessageOptions(images=Images.BOTH, preset=preset)
        for cameras in (CAMERA_NAMES, numbered):
            for image_topic in IMAGE_TOPICS:
                for row in make_table(cameras, image_topic, options):
                    found[row.topic] = row
    return found


def sample_topics() -> dict[str, Stream]:
    """Return the topics of scans and images, with their streams."""
    return {name: row.stream for name, row in own_topics().items() if row.on_demand}
