# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a serialised tf2_msgs/TFMessage, without objects: /tf may have 1000 a second."""

from __future__ import annotations

import struct
from typing import NamedTuple

from ..model.stamps import from_sec_nanosec

_BASE = 4  # the encapsulation header, after which alignment counts


class StampedNumbers(NamedTuple):
    """A transform of a message.

    Attributes:
        stamp_ns: Its stamp, nanoseconds.
        parent, child: Its frames, as they are written.
        numbers: x y z, metres, and x y z w of the quaternion.
    """

    stamp_ns: int
    parent: str
    child: str
    numbers: tuple[float, ...]


def read_transforms(data: bytes | memoryview) -> list[StampedNumbers]:
    """Read the transforms of a TFMessage: a sequence of header, child_frame_id and transform.

    Raises:
        ValueError: The message is truncated.
    """
    order = '<' if data[1:2] == b'\1' else '>'
    head, length, body = (struct.Struct(order + each) for each in ('iII', 'I', '7d'))
    found = []
    try:
        (count,) = length.unpack_from(data, _BASE)
        place = _BASE + length.size
        for _ in range(count):
            place = _aligned(place, 4)
            sec, nanosec, size = head.unpack_from(data, place)
            place += head.size
            parent, place = _text(data, place, size), _aligned(place + size, 4)
            (size,) = length.unpack_from(data, place)
            place += length.size
            child, place = _text(data, place, size), _aligned(place + size, 8)
            numbers = body.unpack_from(data, place)
            place += body.size
            found.append(StampedNumbers(from_sec_nanosec(sec, nanosec), parent, child, numbers))
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f'a TFMessage of {len(data)} bytes is truncated') from error
    return found


def _aligned(place: int, size: int) -> int:
    return place + (_BASE - place) % size


def _text(data: bytes | memoryview, place: int, size: int) -> str:
    return bytes(data[place : place + size]).rstrip(b'\0').decode()
