# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Selection of the topics of a bag to play, and of the image topics made from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..messages.ros_types import TYPESTORE
from ..messages.selected_topics import match_names, unmatched
from ..model.channels import Channel
from ..model.errors import UsageError
from ..model.msgtypes import HEADER, IMAGE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import BagMessages
    from ..messages.ros_types import Typestore
    from ..options.selection import SelectionOptions

_OF_IMAGE = (IMAGE, HEADER, 'builtin_interfaces/msg/Time')
_DEPTH = 10


@dataclass(frozen=True)
class ImageTopics:
    """Image topics played in addition to those of a bag, or in their place.

    Attributes:
        sources: Made topic to the topic of the bag that it is made from.
        hidden: Topics of the bag that are not played.
        notes: Remarks for the user, one line each.
    """

    sources: Mapping[str, str] = field(default_factory=dict)
    hidden: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlayedTopics:
    """The topics of a bag to play.

    Attributes:
        names: The topics, including made ones.
        sources: See ImageTopics.
        notes: Remarks for the user, one line each.
    """

    names: tuple[str, ...]
    sources: Mapping[str, str]
    notes: tuple[str, ...]

    @property
    def read(self) -> frozenset[str]:
        """The topics to read from the bag."""
        return frozenset(self.sources.get(name, name) for name in self.names)

    def channels(self, messages: BagMessages, counts: Mapping[str, int]) -> list[Channel]:
        """Return the channels of the topics.

        A latched one queues the messages of one round at most: a deeper queue would fill with
        copies when the bag is repeated.

        Args:
            messages: The bag.
            counts: The readable topics of the bag, with their numbers of messages.
        """
        own = [
            Channel(
                topic,
                msgtype,
                latched=topic in messages.latched,
                depth=min(messages.latched[topic], counts[topic])
                if topic in messages.latched
                else _DEPTH,
            )
            for topic, msgtype in messages.channels
            if topic in counts and topic in self.names
        ]
        return own + [
            Channel(name, IMAGE, depth=_DEPTH)
            for name in self.names
            if self.sources.get(name) in counts
        ]

    def made(self, channels: Sequence[Channel]) -> dict[str, list[int]]:
        """Map topics of the bag to the indices of the channels made from them."""
        found: dict[str, list[int]] = {}
        for index, channel in enumerate(channels):
            if channel.topic in self.sources:
                found.setdefault(self.sources[channel.topic], []).append(index)
        return found


def choose_topics(
    path: Path,
    counts: Mapping[tuple[str, str], int],
    selection: SelectionOptions,
    reserved: Callable[[str, str], str],
    made: ImageTopics,
) -> PlayedTopics:
    """Choose the topics of a bag to play.

    Args:
        path: The bag, for error messages.
        counts: Message counts by topic and type.
        selection: Requested topics.
        reserved: Maps a topic and its type to the reason for skipping it, or to an empty string.
        made: Image topics to be made.

    Raises:
        UsageError: The selection matches no topic, or only skipped ones.
    """
    reasons = {key: why for key in counts if (why := reserved(*key))}
    names = {topic for topic, _ in counts} | {*made.sources}
    wanted = match_names(sorted(names - made.hidden), selection)
    left_out = tuple(
        f'{path}: {key[0]} is left out, {counts[key]} messages: {why}'
        for key, why in reasons.items()
        if counts[key] and key[0] in wanted
    )
    played = tuple(name for name in wanted if name not in {topic for topic, _ in reasons})
    if left_out and not played:
        raise UsageError(left_out[0])
    unknown = unmatched(names, selection)
    return PlayedTopics(played, made.sources, (*left_out, *unknown, *made.notes))


def define_images(typestore: Typestore) -> None:
    """Add the definition of sensor_msgs/Image to the types of a bag if it is missing."""
    missing = [name for name in _OF_IMAGE if name not in typestore.fielddefs]
    typestore.register({name: TYPESTORE.fielddefs[name] for name in missing})
