# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The small types common to all messages: Time, Header, points, quaternions, poses."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..model.geometry import Transform
from ..model.stamps import NS_PER_S, from_sec_nanosec, to_sec_nanosec
from .ros_types import Header, Point, Pose, Quaternion, Time, Vector3

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array


_ENCAPSULATION_SIZE = 4
_HEADER_HEAD = 12


def make_header(stamp_ns: int, frame_id: str) -> Header:
    """Make a Header of a stamp in nanoseconds."""
    sec, nanosec = to_sec_nanosec(stamp_ns)
    return Header(Time(sec, nanosec), frame_id)


def stamp_ns_of(header: Header) -> int:
    """Return the stamp of a Header, nanoseconds."""
    return from_sec_nanosec(header.stamp.sec, header.stamp.nanosec)


def peek_header(data: bytes | memoryview) -> tuple[int, str]:
    """Read stamp (nanoseconds) and frame of a serialised message whose first field is a Header.

    Raises:
        ValueError: The message is too short.
    """
    order = '<' if data[1:2] == b'\1' else '>'
    try:
        sec, nanosec, length = struct.unpack_from(f'{order}iII', data, _ENCAPSULATION_SIZE)
    except struct.error as error:
        raise ValueError(f'a message of {len(data)} bytes has no header') from error
    start = _ENCAPSULATION_SIZE + _HEADER_HEAD
    frame = bytes(data[start : start + length]).rstrip(b'\0')
    return sec * NS_PER_S + nanosec, frame.decode(errors='replace')


def peek_first_stamp(data: bytes | memoryview) -> int:
    """Read the stamp (nanoseconds) of the first element of a serialised array of stamped messages.

    0 without an element, or if the message is too short.
    """
    order = '<' if data[1:2] == b'\1' else '>'
    try:
        count, sec, nanosec = struct.unpack_from(f'{order}IiI', data, _ENCAPSULATION_SIZE)
    except struct.error:
        return 0
    return sec * NS_PER_S + nanosec if count else 0


def body_after_header(data: bytes | memoryview) -> bytes:
    """Return the bytes after the Header at the start of a serialised message, with padding.

    Empty if the message is too short.
    """
    start = _ENCAPSULATION_SIZE + _HEADER_HEAD
    order: Literal['little', 'big'] = 'little' if data[1:2] == b'\1' else 'big'
    length = int.from_bytes(data[start - 4 : start], order)
    return bytes(data[start + length :])


def make_vector3(xyz: Sequence[float] | Float64Array) -> Vector3:
    """Make a Vector3 of three numbers."""
    x, y, z = (float(value) for value in xyz)
    return Vector3(x, y, z)


def make_quaternion(xyzw: Float64Array) -> Quaternion:
    """Make a Quaternion of x, y, z, w."""
    x, y, z, w = (float(value) for value in xyzw)
    return Quaternion(x, y, z, w)


def make_pose(transform: Transform) -> Pose:
    """Make the Pose of b in a of a transform a_T_b."""
    x, y, z = (float(value) for value in transform.translation)
    return Pose(Point(x, y, z), make_quaternion(transform.quaternion()))


def pose_numbers(transform: Transform) -> tuple[float, ...]:
    """Return x y z, then x y z w of the quaternion: the fields of a Pose, in its order."""
    return (*transform.translation.tolist(), *transform.quaternion().tolist())


def transform_of(pose: Pose) -> Transform:
    """Convert a Pose to a transform: the inverse of make_pose."""
    q, p = pose.orientation, pose.position
    return Transform.from_quaternion((q.x, q.y, q.z, q.w), (p.x, p.y, p.z))


def vector_of(vector: Vector3) -> Float64Array:
    """Return (3,) float64 of a Vector3."""
    return np.array([vector.x, vector.y, vector.z])
