# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Channels with Foxglove's schemas, which appear as channels of ROS messages.

A channel of foxglove.PointCloud in protobuf or JSON, or of foxglove_msgs/PointCloud, appears as
sensor_msgs/msg/PointCloud2 with CDR; everything that reads bags sees ROS messages only.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mcap.records import Schema

from ..messages.foxglove_fields import Fields, JsonFields
from ..messages.foxglove_messages import TRANSLATIONS, Translation, translate
from ..model.errors import KittiRos2Error
from .pieces import StoredChannel
from .ros1_messages import ros1_to_cdr

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    from rosbags.typesys.store import Typestore

    from .pieces import Buffer

    Translate: TypeAlias = Callable[[Buffer, int], bytes]

_PACKAGES = ('foxglove.', 'foxglove_msgs/msg/', 'foxglove_msgs/')
_ROS = frozenset({'cdr', 'ros1'})
_ENCODINGS = _ROS | {'protobuf', 'json'}

_ADVICE = {
    'CompressedVideo': (
        'single images of a video cannot be read; write them as CompressedImage (JPEG or PNG)'
    ),
    'CompressedPointCloud': 'the points are compressed; write them as PointCloud',
}


class MissingLibraryError(KittiRos2Error):
    """A library that reads an encoding is not installed."""


@dataclass(frozen=True)
class FoxgloveChannel(StoredChannel):
    """A channel with a schema of Foxglove, as it appears: as ROS messages in CDR.

    Attributes:
        original: As stored in the file.
    """

    original: StoredChannel = field(kw_only=True)

    @property
    def is_ros(self) -> bool:
        """Whether its stored messages are of a ROS type, which the bag defines."""
        return self.original.encoding in _ROS


def appearing(channel: StoredChannel) -> StoredChannel:
    """Return a channel as it appears to readers."""
    translation = TRANSLATIONS.get(_schema_of(channel))
    if translation is None or channel.encoding not in _ENCODINGS:
        return channel
    return FoxgloveChannel(
        channel.topic,
        translation.msgtype,
        'cdr',
        original=channel,
        latched=channel.latched,
        depth=channel.depth,
        profiles=channel.profiles,
    )


def stored(channel: StoredChannel) -> StoredChannel:
    """Return a channel as stored in its file: the inverse of appearing."""
    return channel.original if isinstance(channel, FoxgloveChannel) else channel


def described(channel: StoredChannel) -> StoredChannel:
    """Return the channel whose definition describes ROS types."""
    return channel.original if isinstance(channel, FoxgloveChannel) and channel.is_ros else channel


def types_of(channel: StoredChannel) -> tuple[str, ...]:
    """Return the ROS types that messages of a channel are decoded by, stored and converted."""
    return tuple(dict.fromkeys((described(channel).msgtype, channel.msgtype)))


def why_unread(channel: StoredChannel) -> str:
    """Return why a channel that is neither in CDR nor of ROS 1 is not read."""
    encoding = channel.encoding or 'in an encoding that is not named'
    text = f'{channel.topic} is {encoding}, which is not read'
    schema = _schema_of(channel)
    if not schema:
        return text
    advice = _ADVICE.get(schema)
    if channel.encoding in _ENCODINGS:
        text = f'{channel.topic} is {channel.msgtype} in {channel.encoding}, which is not read'
    elif schema in TRANSLATIONS:
        advice = 'write it in protobuf or JSON'
    return f'{text}: {advice}' if advice else text


def translator(channel: FoxgloveChannel, typestore: Callable[[], Typestore]) -> Translate:
    """Return the function that converts a stored message and its log time (ns) to CDR.

    Args:
        channel: The channel.
        typestore: Returns the types of the bag, for messages of ROS.

    Raises:
        MissingLibraryError: The library that reads protobuf is not installed.
        ValueError: The channel's schema is damaged.
    """
    translation = TRANSLATIONS[_schema_of(channel.original)]
    if channel.original.encoding == 'json':
        return _from_json(translation)
    if channel.original.encoding == 'protobuf':
        return _from_protobuf(channel.original, translation)
    return _from_ros(channel.original, translation, typestore)


def _schema_of(channel: StoredChannel) -> str:
    """Return the name of a schema of Foxglove without its package, empty for others."""
    for package in _PACKAGES:
        if channel.msgtype.startswith(package):
            return channel.msgtype[len(package) :]
    return ''


def _from_json(translation: Translation) -> Translate:
    def convert(data: Buffer, log_ns: int) -> bytes:
        try:
            message = json.loads(bytes(data))
        except RecursionError as error:
            raise ValueError('its JSON is nested too deeply') from error
        except ValueError as error:  # places in the text differ between messages
            raise ValueError('it is no JSON') from error
        return translate(translation, JsonFields(message), log_ns)

    return convert


def _from_protobuf(channel: StoredChannel, translation: Translation) -> Translate:
    try:
        from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - optional, and 30 ms
    except ImportError as error:
        raise MissingLibraryError(
            f'{channel.topic} is {channel.msgtype} in protobuf, which needs mcap-protobuf-support;'
            " run pip install 'kitti_ros2[foxglove]'"
        ) from error
    schema = Schema(
        id=1, name=channel.msgtype, encoding=channel.definition_encoding, data=channel.schema
    )
    try:
        decode = DecoderFactory().decoder_for(channel.encoding, schema)
    except Exception as error:  # the library and protobuf raise errors of many classes
        reason = ' '.join(str(error).split())
        raise ValueError(f'its schema is damaged ({reason})') from error
    if decode is None:
        raise ValueError(f'its schema is in {channel.definition_encoding or "no encoding"}')

    def convert(data: Buffer, log_ns: int) -> bytes:
        try:
            message: Any = decode(bytes(data))
        except Exception as error:
            raise ValueError('it is no protobuf message of its schema') from error
        return translate(translation, Fields(message), log_ns)

    return convert


def _from_ros(
    channel: StoredChannel, translation: Translation, typestore: Callable[[], Typestore]
) -> Translate:
    def convert(data: Buffer, log_ns: int) -> bytes:
        store = typestore()
        if channel.encoding == 'ros1':
            data = ros1_to_cdr(store, data, channel.msgtype)
        message = store.deserialize_cdr(data, channel.msgtype)
        return translate(translation, Fields(message), log_ns)

    return convert
