# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Copies of the messages of bags to a new bag of any container.

Messages keep their bytes unless the new container has another serialisation. ROS 1 and ROS 2 become
each other: see messages.ros_versions. Messages with Foxglove's schemas become those of ROS.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ..messages.ros_versions import RENAMED, Ros1Types, Ros2Types
from ..model.bag_formats import CONTAINERS, Channel
from ..model.errors import KittiRos2Error, describe_error, format_count
from .container_file import StoredChannel, latched_qos
from .reader import BagMessages
from .ros1_bag import Ros1Channel
from .ros1_writer import ros1_channel
from .stored_messages import stored_channel

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from rosbags.typesys.store import Typestore

    from ..messages.ros_versions import Convert, Migration
    from .bag_files import BagSource
    from .reader import BagMessage
    from .writer import BagWriter


# What becomes of the channels of a bag in another container.

_FOXGLOVE = frozenset({'protobuf', 'json'})
_ROS2_NAME = re.compile(r'/?(?:(?!\w*__)[A-Za-z_]\w*/)*(?!\w*__)[A-Za-z_]\w*', re.ASCII)


class Outlet(NamedTuple):
    """A channel of the new bag, and the conversion of its messages; None copies them."""

    channel: Channel
    convert: Convert | None = None


class ToRos2:
    """Makes the channels of a bag of ROS 2.

    Args:
        messages: The bags, opened by open_copied.

    Attributes:
        typestore: The types of the new bag.
        migration: Makes messages of types that ROS 1 defines otherwise; None without ROS 1.
        notes: Changes of channels so far, one line each.
    """

    def __init__(self, messages: BagMessages) -> None:
        sources = messages.sources.values()
        kept = [channel.msgtype for channel in sources if not _is_ros1(channel)]
        self._types: Ros2Types | None = None
        self.migration: Migration | None = None
        self.typestore: Typestore = messages.typestore
        if any(map(_is_ros1, sources)):
            self._types = Ros2Types(messages.typestore, kept)
            self.migration = self._types.migration
            self.typestore = messages.with_texts(self._types.typestore)
        self.notes: dict[str, None] = {}

    def outlet(self, channel: StoredChannel) -> Outlet:
        """Return what becomes of a channel.

        Raises:
            Exception: Its type cannot be written.
        """
        if not _ROS2_NAME.fullmatch(channel.topic):
            self.notes[f'{channel.topic} is no valid topic in ROS 2, which cannot play it'] = None
        if not channel.profiles and channel.topic.endswith('tf_static') and not channel.latched:
            self.notes[
                f'{channel.topic} has no QoS in the bag; it is latched in the new one, as ROS 2'
                f' expects it'
            ] = None
            channel = replace(channel, **latched_qos())
        if self._types is None or not _is_ros1(channel):
            return Outlet(channel)
        made = RENAMED.get(channel.msgtype, channel.msgtype)
        if made != channel.msgtype:
            self.notes[f'{channel.msgtype} of ROS 1 is written as {made}'] = None
        return Outlet(replace(channel, msgtype=made), self._types.converter(channel.msgtype))


class ToRos1:
    """Makes the channels of a ROS 1 bag; see ToRos2."""

    def __init__(self, messages: BagMessages) -> None:
        self.typestore: Typestore = messages.typestore
        self._types = Ros1Types(messages.typestore)
        self.migration: Migration | None = self._types.migration
        self.notes: dict[str, None] = {}

    def outlet(self, channel: StoredChannel) -> Outlet:
        """Return what becomes of a channel.

        Raises:
            Exception: Its type cannot be written.
        """
        if isinstance(channel, Ros1Channel):
            return Outlet(channel)
        if not _is_ros1(channel):
            convert = self._types.converter(channel.msgtype)
            return Outlet(ros1_channel(channel, self._types), convert)
        made = Ros1Channel(
            channel.topic,
            channel.msgtype,
            'ros1',
            channel.definition,
            'ros1msg',
            _md5sum(channel),
            latched=channel.latched,
            depth=channel.depth,
        )
        return Outlet(made)


def _is_ros1(channel: StoredChannel) -> bool:
    return stored_channel(channel).encoding == 'ros1'


def _md5sum(channel: StoredChannel) -> str:
    """Return the MD5 sum of a ROS 1 type in MCAP, which does not store it."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(channel.definition, channel.msgtype))
    return store.generate_msgdef(channel.msgtype, ros_version=1)[1]


# The copy.


def open_copied(
    bags: list[BagSource],
    storage: str,
    topics: Collection[str] | None = None,
    *,
    foxglove: bool = False,
) -> BagMessages:
    """Open bags to copy their messages to a container.

    Args:
        bags: The bags.
        storage: The container, one of model.bag_formats.
        topics: The topics to read; all of them by default.
        foxglove: Whether messages with Foxglove's schemas in protobuf or JSON become those of ROS;
            else they are lost.
    """
    converted = _FOXGLOVE if foxglove else frozenset()
    if CONTAINERS[storage].encoding != 'ros1':
        converted |= {'ros1'}
    return BagMessages(bags, topics, as_stored=True, converted=converted, must_read=False)


def outlets_of(messages: BagMessages, storage: str) -> ToRos1 | ToRos2:
    """Return what makes the channels of the new bag, which open_copied opened bags for."""
    is_ros1 = CONTAINERS[storage].encoding == 'ros1'
    return ToRos1(messages) if is_ros1 else ToRos2(messages)


_CAUSES: dict[type[Exception], str] = {
    RecursionError: 'its definition refers to itself',
    KeyError: 'neither the bag nor ROS 2 Jazzy defines it',
}


class MessageCopy:
    """A copy in progress: writes messages, and counts those that the new bag cannot hold.

    Args:
        messages: The bags, opened by open_copied.
        storage: The container of the new bag.
        made: From outlets_of.
        writer: The new bag, with the types of made.

    Attributes:
        counts: Messages by topic.
        size_bytes: Bytes of all messages.
        first_ns, last_ns: Log times of the first and the last message; None and 0 without any.
        notes: Notes, one line each.
    """

    def __init__(
        self, messages: BagMessages, storage: str, made: ToRos1 | ToRos2, writer: BagWriter
    ) -> None:
        self._storage, self._made, self._writer = storage, made, writer
        self._outlets: dict[str, tuple[int, Convert | None]] = {}
        self._unwritten: dict[str, str] = {}
        self._first_lost: dict[tuple[str, str], str] = {}
        self._left_out: Counter[tuple[str, str]] = Counter()
        self.counts: dict[str, int] = {}
        self.size_bytes = 0
        self.first_ns: int | None = None
        self.last_ns = 0
        self._losses: Counter[str] = Counter()
        self._add_channels(messages.sources)
        self.notes = tuple(self._made.notes)

    @property
    def complete(self) -> bool:
        """True if nothing is lost so far."""
        return not self._losses and not self._left_out

    @property
    def losses(self) -> dict[str, int]:
        """Reasons why messages cannot be written whole, with the number of messages lost."""
        ros = 'ROS 1' if isinstance(self._made, ToRos1) else 'ROS 2'
        left_out = {
            f'{topic}: {ros} has no field {name}; its values are left out of'
            f' {format_count(count, "message")}': 0
            for (topic, name), count in self._left_out.items()
        }
        return {**self._losses, **left_out}

    def _add_channels(self, sources: Mapping[str, StoredChannel]) -> None:
        for topic, channel in sorted(sources.items()):
            try:
                made, convert = self._made.outlet(channel)
                self._outlets[topic] = self._writer.add_channel(made), convert
            except (KittiRos2Error, MemoryError):
                raise
            except Exception as error:  # noqa: BLE001 - types of any kind
                why = _CAUSES.get(type(error), error)
                text = f'{topic}: {channel.msgtype} cannot be written to {self._storage} ({why})'
                self._unwritten[topic] = text
                self._losses[text] = 0
            else:
                self.counts[topic] = 0

    def take(self, message: BagMessage) -> None:
        """Write a message.

        Raises:
            OutputError: The disk refuses.
        """
        topic = message.topic
        if topic not in self._outlets:
            self._losses[self._unwritten[topic]] += 1
            return
        channel_id, convert = self._outlets[topic]
        try:
            _check_stamp(message.stamp_ns, self._storage)
            parts = (message.data,) if convert is None else convert((message.data,))
            self._writer.write(channel_id, message.stamp_ns, parts)
        except (KittiRos2Error, MemoryError):
            raise
        except Exception as error:  # noqa: BLE001 - converters may raise anything
            reason = describe_error(error)
            text = f'{topic}: messages from {message.stamp_ns} on cannot be written ({reason})'
            self._losses[self._first_lost.setdefault((topic, reason), text)] += 1
            return
        if self.first_ns is None:
            self.first_ns = message.stamp_ns
        self.last_ns = message.stamp_ns
        self.counts[topic] += 1
        self.size_bytes += sum(map(len, parts))
        if convert is not None:
            self._count_left_out(topic)

    def _count_left_out(self, topic: str) -> None:
        migration = self._made.migration
        if migration is None or not migration.left_out:
            return
        self._left_out.update((topic, name) for name in sorted(migration.left_out))
        migration.left_out.clear()


def _check_stamp(stamp_ns: int, storage: str) -> None:
    # A damaged record may have any stamp.
    if not 0 <= stamp_ns < CONTAINERS[storage].stamp_limit_ns:
        raise ValueError(f'{storage} has no such time')
