# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What messages become: components of entities, and where entities are called what."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import rerun as rr

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rerun import AsComponents

    from .camera_rig import CameraRig
    from .program_survey import ProgramSurvey

TIME = 'time'
FRAME = 'frame'


class TimePoint(NamedTuple):
    """When a message is: nanoseconds since 1970, and the number of its frame."""

    stamp_ns: int
    frame: int


class EntityUpdate(NamedTuple):
    """Components for one entity, at the time of their message.

    Attributes:
        path: Entity path, escaped as entity_path does it.
        components: Archetypes.
        frame: Coordinate frame of the entity, a header's frame_id; '' where nothing tells.
        always: Archetypes that hold for all time.
    """

    path: str
    components: Sequence[AsComponents] = ()
    frame: str = ''
    always: Sequence[AsComponents] = ()


@dataclass
class Curve:
    """Scalars of one entity at many moments, which together cost as much as one alone.

    Attributes:
        path: Entity path.
        times: In order of time.
        values: Of each time, all of the same number.
    """

    path: str
    times: list[TimePoint] = field(default_factory=list)
    values: list[tuple[float, ...]] = field(default_factory=list)


Shown: TypeAlias = 'EntityUpdate | Curve'


@dataclass(frozen=True)
class Context:
    """What the topics of a recording share.

    Attributes:
        survey: What the first moments tell.
        rig: The cameras.
        note: Takes what is worth a word; the same word is told once.
    """

    survey: ProgramSurvey
    rig: CameraRig
    note: Callable[[str], object]


class Converter:
    """Shows the messages of one topic."""

    def __init__(self, topic: str, context: Context) -> None:
        self.topic = topic
        self.path = entity_path(topic)
        self.context = context

    def convert(self, message: Any, time: TimePoint) -> Iterable[Shown]:  # noqa: ANN401 - a rosbags class
        """What is to be shown now.

        Raises:
            ValueError: The message cannot be decoded. So may anything else of a broken one.
        """
        raise NotImplementedError

    def flush(self) -> Iterable[Shown]:
        """What is to be shown when there are no more messages."""
        return ()


@lru_cache(maxsize=4096)
def entity_path(topic: str, *below: str) -> str:
    """The entity of a topic, or of a part of it: /camera/image -> camera/image."""
    parts = [part for part in topic.split('/') if part] + list(below)
    return '/'.join(rr.escape_entity_path_part(part) for part in parts)


def image_frame(image: str) -> str:
    """The frame of an image topic's pixels."""
    return f'{image.strip("/")}/pixels'
