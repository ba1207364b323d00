# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Serialisation of ROS messages to CDR and back.

A serialised message is a sequence of buffers, which a bag writes one after the other: the bulk data
of a scan or an image is never copied between files.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from enum import Enum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..model.msgtypes import CLOUD, COMPRESSED, HEADER, IMAGE, POSE
from .ros_types import TYPESTORE
from .type_definitions import nested_type

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

Parts: TypeAlias = 'tuple[bytes | memoryview, ...]'
"""A serialised message, in consecutive buffers."""

_EMPTY = np.empty(0, dtype=np.uint8)
_LENGTH = struct.Struct('<I')
_STAMP = struct.Struct('<iI')
_STAMP_OFFSET = 4
_TIMESTAMP = 'timestamp'
"""The field that messages of Foxglove have for a header."""

# Bytes that follow the bulk field (`data`, uint8[]) of the message types that have one.
BULK_TAIL = {
    COMPRESSED: 0,
    IMAGE: 0,
    CLOUD: 1,
}


class Message(NamedTuple):
    """One serialised message.

    Attributes:
        channel: Index of its channel in Encoder.table, or in the channels of a program.
        stamp_ns: Header stamp and log time, nanoseconds since 1970.
        parts: CDR with its encapsulation header, in consecutive buffers; none if it was not made
            because its channel is on demand and has no subscriber.
        key: A change key; a message with the key of the channel's last one is not sent again.
    """

    channel: int
    stamp_ns: int
    parts: Parts
    key: Hashable = None

    @property
    def data(self) -> bytes:
        """The parts as one buffer, not copied if there is only one."""
        return join(self.parts)


def serialize(message: Any) -> Parts:  # noqa: ANN401 - one of many generated classes
    """Serialise a message of a rosbags class as little-endian CDR, encapsulation header included.

    Its length is a multiple of four, as subscribers receive it and rosbag2 records it: a submessage
    of RTPS (OMG formal/2022-04-01, 9.4.1) is padded with zeros.
    """
    msgtype = message.__msgtype__
    tail = BULK_TAIL.get(msgtype)
    if tail is None:
        data = bytes(TYPESTORE.serialize_cdr(message, msgtype))
        return (data + filling(len(data)),)
    bulk = memoryview(message.data).cast('B')
    hollow = bytes(TYPESTORE.serialize_cdr(replace(message, data=_EMPTY), msgtype))
    split = len(hollow) - tail
    head = hollow[: split - _LENGTH.size] + _LENGTH.pack(len(bulk))
    end = hollow[split:] + filling(len(hollow) + len(bulk))
    return (head, bulk, end) if end else (head, bulk)


def filling(length: int) -> bytes:
    """Return the zeros that pad a serialised message to a multiple of four."""
    return bytes(-length % 4)


def join(parts: Sequence[bytes | memoryview]) -> bytes:
    """Join a serialised message to one bytes object."""
    return parts[0] if len(parts) == 1 and isinstance(parts[0], bytes) else b''.join(parts)


def deserialize(data: bytes | memoryview, msgtype: str) -> Any:  # noqa: ANN401 - as serialize
    """Deserialise CDR to a message of a rosbags class."""
    return TYPESTORE.deserialize_cdr(data, msgtype)


def restamp(parts: Parts, stamp_ns: int) -> Parts:
    """Replace the header.stamp of a message whose first field is a Header."""
    head = bytearray(parts[0])
    _STAMP.pack_into(head, _STAMP_OFFSET, *divmod(stamp_ns, 1_000_000_000))
    return (bytes(head), *parts[1:])


def restamp_message(data: bytes, msgtype: str, stamp_ns: int) -> bytes:
    """Replace every header.stamp and timestamp in a serialised message, if it has any.

    The poses of a Path keep their stamps, the times of these positions.
    """
    places = _headers(msgtype)
    if places is _Headers.FIRST:
        patched = bytearray(data)
        _STAMP.pack_into(patched, _STAMP_OFFSET, *divmod(stamp_ns, 1_000_000_000))
        return bytes(patched)
    if places is _Headers.WITHIN:
        message = deserialize(data, msgtype)
        _restamp_within(message, stamp_ns)
        return join(serialize(message))
    return data


class _Headers(Enum):
    NONE = 0
    FIRST = 1
    WITHIN = 2


@lru_cache(maxsize=64)
def _headers(msgtype: str) -> _Headers:
    """Return where a type has headers: none, as its first field only, or nested; or timestamps.

    Types without a definition in this package count as without headers.
    """
    if msgtype not in TYPESTORE.fielddefs:
        return _Headers.NONE
    described = TYPESTORE.fielddefs[msgtype][1]
    if any(name == _TIMESTAMP for name, _ in described):
        return _Headers.WITHIN
    fields = [nested_type(description) for _, description in described]
    inner = [name for name in fields if name and name not in (HEADER, POSE)]
    if any(_headers(name) is not _Headers.NONE for name in inner):
        return _Headers.WITHIN
    return _Headers.FIRST if fields[:1] == [HEADER] else _Headers.NONE


def _restamp_within(message: Any, stamp_ns: int) -> None:  # noqa: ANN401 - any rosbags class
    if message.__msgtype__ == HEADER:
        message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        return
    for name in message.__dataclass_fields__:
        value = getattr(message, name)
        if name == _TIMESTAMP:
            value.sec, value.nanosec = divmod(stamp_ns, 1_000_000_000)
        for each in value if isinstance(value, list) else [value]:
            if hasattr(each, '__dataclass_fields__'):
                _restamp_within(each, stamp_ns)
