# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS messages to CDR bytes and back, and the type definitions behind them.

A serialised message is a sequence of buffers, which a bag writes one after the other: the bulk of
a scan or an image is never copied on its way from file to file.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .ros_types import TYPESTORE

if TYPE_CHECKING:
    from collections.abc import Sequence

Parts: TypeAlias = 'tuple[bytes | memoryview, ...]'
"""A serialised message, in buffers that follow one another."""

_EMPTY = np.empty(0, dtype=np.uint8)
_LENGTH = struct.Struct('<I')
_STAMP = struct.Struct('<iI')
_STAMP_OFFSET = 4

# Bytes that follow the bulk field (`data`, uint8[]) of the message types that have one.
_BULK_TAIL = {
    'sensor_msgs/msg/CompressedImage': 0,
    'sensor_msgs/msg/Image': 0,
    'sensor_msgs/msg/PointCloud2': 1,
}


def serialize(message: Any) -> Parts:  # noqa: ANN401 - one of many generated classes
    """A message of a rosbags class as little-endian CDR, encapsulation header included."""
    msgtype = message.__msgtype__
    tail = _BULK_TAIL.get(msgtype)
    if tail is None:
        return (bytes(TYPESTORE.serialize_cdr(message, msgtype)),)
    bulk = memoryview(message.data).cast('B')
    hollow = bytes(TYPESTORE.serialize_cdr(replace(message, data=_EMPTY), msgtype))
    split = len(hollow) - tail
    head = hollow[: split - _LENGTH.size] + _LENGTH.pack(len(bulk))
    return (head, bulk, hollow[split:]) if tail else (head, bulk)


def join(parts: Sequence[bytes | memoryview]) -> bytes:
    """A serialised message as one string of bytes."""
    return parts[0] if len(parts) == 1 and isinstance(parts[0], bytes) else b''.join(parts)


def deserialize(data: bytes | memoryview, msgtype: str) -> Any:  # noqa: ANN401 - as serialize
    """A message of a rosbags class from its CDR bytes."""
    return TYPESTORE.deserialize_cdr(data, msgtype)


def restamp(parts: Parts, stamp_ns: int) -> Parts:
    """The same message with another header.stamp; its first field must be a Header."""
    head = bytearray(parts[0])
    _STAMP.pack_into(head, _STAMP_OFFSET, *divmod(stamp_ns, 1_000_000_000))
    return (bytes(head), *parts[1:])
