# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag are played, and which image topics are made of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from ..messages.ros_types import TYPESTORE
from ..messages.topics import match_names
from ..model.errors import UsageError
from .program import Outlet

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from ..bags.message_source import BagMessage, BagMessages
    from ..messages.ros_types import Typestore

IMAGE = 'sensor_msgs/msg/Image'
_OF_IMAGE = (IMAGE, 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time')
_DEPTH = 10


@dataclass(frozen=True)
class ImageTopics:
    """Image topics that are played in addition to a bag's own, or in place of them.

    Attributes:
        sources: By topic that is made, the topic of the bag that it is made of.
        hidden: Topics of the bag that are not played.
        notes: Remarks for the user, a line each.
    """

    sources: Mapping[str, str] = field(default_factory=dict)
    hidden: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


class ImageMaker(Protocol):
    """Makes sensor_msgs/Image of a bag's images."""

    def topics(self, types: Mapping[str, str]) -> ImageTopics:
        """What is made of a bag with these topics; message types by topic."""

    def make(
        self, message: BagMessage, names: Sequence[str], typestore: Typestore
    ) -> list[bytes | ValueError]:
        """For each of the topics that are made of a message: the CDR, or why there is none."""


class AsItIs:
    """Makes nothing: a bag is played as it is."""

    @staticmethod
    def topics(types: Mapping[str, str]) -> ImageTopics:  # noqa: ARG004 - see ImageMaker
        """None."""
        return ImageTopics()

    @staticmethod
    def make(*_: object) -> list[bytes | ValueError]:
        """Nothing."""
        return []


@dataclass(frozen=True)
class PlayedTopics:
    """What is played of a bag.

    Attributes:
        names: The topics, those that are made among them.
        sources: As ImageTopics has them.
        notes: Remarks for the user, a line each.
    """

    names: tuple[str, ...]
    sources: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def read(self) -> frozenset[str]:
        """The topics of the bag that are needed."""
        return frozenset(self.sources.get(name, name) for name in self.names)

    def outlets(self, messages: BagMessages, topics: Collection[str]) -> list[Outlet]:
        """The topics as outlets.

        Args:
            messages: The bag.
            topics: Those of the bag that can be read.
        """
        own = [
            Outlet(
                topic,
                msgtype,
                topic in messages.latched,
                messages.latched.get(topic, _DEPTH),
            )
            for topic, msgtype in messages.channels
            if topic in topics and topic in self.names
        ]
        return own + [
            Outlet(name, IMAGE, latched=False, depth=_DEPTH)
            for name in self.names
            if self.sources.get(name) in topics
        ]

    def made(self, outlets: Sequence[Outlet]) -> dict[str, list[int]]:
        """By topic of the bag the indices of the outlets that are made of it."""
        found: dict[str, list[int]] = {}
        for index, outlet in enumerate(outlets):
            if outlet.name in self.sources:
                found.setdefault(self.sources[outlet.name], []).append(index)
        return found


def choose_topics(
    path: Path,
    counts: Mapping[tuple[str, str], int],
    patterns: tuple[str, ...],
    reserved: Callable[[str, str], str],
    images: ImageMaker,
) -> PlayedTopics:
    """The topics of a bag that are played.

    Args:
        path: The bag, for messages.
        counts: How many messages a topic has, by topic and type.
        patterns: Names that are wanted, wildcards allowed; none takes all.
        reserved: Given a topic and its type, why the bag's messages of it are left out, or nothing.
        images: Makes image topics that the bag does not contain.

    Raises:
        UsageError: The patterns match nothing, or only what is left out.
    """
    made = images.topics(dict(counts.keys()))
    reasons = {key: why for key in counts if (why := reserved(*key))}
    names = {topic for topic, _ in counts} | {*made.sources}
    wanted = match_names(sorted(names - made.hidden), patterns)
    left_out = tuple(
        f'{path}: {key[0]} is left out, {counts[key]} messages: {why}'
        for key, why in reasons.items()
        if counts[key] and key[0] in wanted
    )
    played = tuple(name for name in wanted if name not in {topic for topic, _ in reasons})
    if left_out and not played:
        raise UsageError(left_out[0])
    return PlayedTopics(played, made.sources, (*left_out, *made.notes))


def define_images(typestore: Typestore) -> None:
    """Add the definition of an image to the types of a bag where it is missing."""
    missing = [name for name in _OF_IMAGE if name not in typestore.fielddefs]
    typestore.register({name: TYPESTORE.fielddefs[name] for name in missing})
