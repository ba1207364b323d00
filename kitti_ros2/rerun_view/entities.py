# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rerun entities: updates of their components, their converters, and their paths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import rerun as rr

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rerun import AsComponents

    from .program_survey import CameraRig, ProgramSurvey

TIME = 'time'
FRAME = 'frame'


class TimePoint(NamedTuple):
    """A point on both timelines: nanoseconds since 1970, and the frame number."""

    stamp_ns: int
    frame: int


class EntityUpdate(NamedTuple):
    """Components for one entity, at the time of their message.

    Attributes:
        path: Entity path, escaped as entity_path does it.
        components: Archetypes.
        frame: Coordinate frame of the entity, a header's frame_id; '' if unknown.
        always: Static archetypes, valid for all time.
        scalars: Numbers of a curve; those of many times are sent together for efficiency.
    """

    path: str
    components: Sequence[AsComponents] = ()
    frame: str = ''
    always: Sequence[AsComponents] = ()
    scalars: tuple[float, ...] = ()


@dataclass(frozen=True)
class Context:
    """Data shared by the converters of a recording.

    Attributes:
        survey: The survey of the program's beginning.
        rig: The cameras.
        note: Takes a remark; equal remarks are shown once.
    """

    survey: ProgramSurvey
    rig: CameraRig
    note: Callable[[str], object]


class Converter:
    """Converts the messages of one topic."""

    def __init__(self, topic: str, context: Context) -> None:
        self.topic = topic
        self.path = entity_path(topic)
        self.context = context

    def convert(self, message: Any) -> Iterable[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield the updates of a message.

        Raises:
            ValueError: The message cannot be decoded; a damaged one may raise any exception.
        """
        raise NotImplementedError

    def flush(self) -> Iterable[EntityUpdate]:
        """Yield the remaining updates after the last message."""
        return ()


@lru_cache(maxsize=4096)
def entity_path(topic: str, *below: str) -> str:
    """Return the entity path of a topic, or of a part of it: /camera/image -> camera/image."""
    parts = [part for part in topic.split('/') if part] + list(below)
    return '/'.join(rr.escape_entity_path_part(part) for part in parts)


def image_frame(image: str) -> str:
    """Return the frame of an image topic's pixels."""
    return f'{image.strip("/")}/pixels'
