# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a message becomes: components of entities, and where entities are called what."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import rerun as rr

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .survey import Survey

TIME = 'time'
FRAME = 'frame'


class Entry(NamedTuple):
    """Components for one entity, at the time of their message.

    Attributes:
        path: Entity path, escaped as entity_path does it.
        components: Archetypes.
        frame: Coordinate frame of the entity, a header's frame_id; '' where nothing tells.
        always: Archetypes that hold for all time.
    """

    path: str
    components: Sequence[rr.AsComponents]
    frame: str = ''
    always: Sequence[rr.AsComponents] = ()


@dataclass(frozen=True)
class Context:
    """What the topics of a recording share.

    Attributes:
        survey: What the first moments tell.
        note: Takes what is worth a word; the same word is told once.
    """

    survey: Survey
    note: Callable[[str], None]


@lru_cache(maxsize=4096)
def entity_path(topic: str, *below: str) -> str:
    """The entity of a topic, or of a part of it: /camera/image -> camera/image."""
    parts = [part for part in topic.split('/') if part] + list(below)
    return '/'.join(rr.escape_entity_path_part(part) for part in parts)


def image_frame(image: str) -> str:
    """The frame of an image topic's pixels."""
    return f'{image.strip("/")}/pixels'
