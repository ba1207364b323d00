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
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from rosbags.interfaces import Nodetype

from ..model.bag_formats import CLOUD, COMPRESSED, HEADER, IMAGE, POSE
from ..model.geometry import Transform
from ..model.streams import NS_PER_S, from_sec_nanosec, to_sec_nanosec
from .ros_types import TYPESTORE, Header, Point, Pose, Quaternion, Time, Vector3
from .type_definitions import nested_type

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence

    from rosbags.interfaces.typing import Basename, FieldDesc
    from rosbags.typesys.store import Typestore

    from ..model.geometry import Float64Array


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


# The fields before the bulk, after the stamp of the header: the size of a number, 0 for a string.
_BEFORE_BULK = {COMPRESSED: (0, 0), IMAGE: (0, 4, 4, 0, 1, 4), CLOUD: (0, 4, 4)}
_POINT_FIELD = (0, 4, 1, 4)
_AFTER_POINT_FIELDS = (1, 4, 4)


def split(parts: Sequence[bytes | memoryview], msgtype: str) -> Sequence[bytes | memoryview]:
    """Split a serialised message as serialize does: the bulk becomes a part of its own.

    The message becomes one part if its type has no bulk, or its lengths do not agree.
    """
    tail = BULK_TAIL.get(msgtype)
    if tail is not None and len(parts) > 1 and parts[0][-4:] == _LENGTH.pack(len(parts[1])):
        return parts
    data = memoryview(parts[0] if len(parts) == 1 else join(parts))
    if tail is None:
        return (data,)
    try:
        start = _bulk_start(data, msgtype)
        end = start + _LENGTH.unpack_from(data, start - _LENGTH.size)[0]
    except struct.error:
        return (data,)
    padding = len(data) - end - tail
    return (data[:start], data[start:end], data[end:]) if 0 <= padding < 4 else (data,)


def _bulk_start(data: memoryview, msgtype: str) -> int:
    """Return the offset of the bulk of a little-endian message.

    Raises:
        struct.error: The message is too short.
    """
    position = _skip(data, _STAMP_OFFSET + _STAMP.size, _BEFORE_BULK[msgtype])
    if msgtype == CLOUD:
        position = _skip(data, position, (4,))
        for _ in range(_LENGTH.unpack_from(data, position - 4)[0]):
            position = _skip(data, position, _POINT_FIELD)
        position = _skip(data, position, _AFTER_POINT_FIELDS)
    return _skip(data, position, (4,))


def _skip(data: memoryview, position: int, fields: Sequence[int]) -> int:
    """Return the end of fields, each a number of a size or a string (0), as _BEFORE_BULK has it."""
    for size in fields:
        position += -position % (size or _LENGTH.size)
        position += size or _LENGTH.size + _LENGTH.unpack_from(data, position)[0]
    return position


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
    headers = _headers(msgtype)
    if headers is _Headers.FIRST:
        patched = bytearray(data)
        _STAMP.pack_into(patched, _STAMP_OFFSET, *divmod(stamp_ns, 1_000_000_000))
        return bytes(patched)
    if headers is _Headers.WITHIN:
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
        for nested in value if isinstance(value, list) else [value]:
            if hasattr(nested, '__dataclass_fields__'):
                _restamp_within(nested, stamp_ns)


# Serialisation of CDR field by field, for large and frequent messages.
#
# rosbags generates code for a type when it is first used, 35 ms for the three arrays of labels, and
# needs an object for every point and pose; this writer avoids both. Tests compare the bytes with
# those of rosbags. Format: CDR little endian as in DDS (OMG formal/2008-01-09, 15.3): every number
# is aligned to its size, counted from the end of the four bytes of encapsulation.

_ENCAPSULATION = b'\x00\x01\x00\x00'
_PADDING = tuple(bytes(count) for count in range(8))
_UINT32 = struct.Struct('<I')
_FLOAT32 = struct.Struct('<f')
_INT32 = tuple(struct.Struct(f'<{count}i') for count in range(9))
_DOUBLES = tuple(struct.Struct(f'<{count}d') for count in range(64))


class CdrWriter:
    """A message under construction; fields must be written in the order of the type."""

    __slots__ = ('_data',)

    def __init__(self) -> None:
        self._data = bytearray(_ENCAPSULATION)

    def finish(self) -> bytes:
        """Return the message so far, encapsulation included, padded as cdr.serialize does."""
        return bytes(self._data) + _PADDING[-len(self._data) % 4]

    def block(self, data: bytes) -> None:
        """Write the result of block_bytes: serialised fields with an alignment of at most four."""
        self._align(4)
        self._data += data

    def block_bytes(self) -> bytes:
        """Return the fields so far without encapsulation, for use in other messages."""
        return bytes(self._data[len(_ENCAPSULATION) :])

    def _align(self, size: int) -> None:
        # Without the four bytes of encapsulation.
        self._data += _PADDING[(4 - len(self._data)) % size]

    def uint32(self, value: int) -> None:
        """Write a uint32, or the length of a sequence."""
        self._align(4)
        self._data += _UINT32.pack(value)

    def int32(self, *values: int) -> None:
        """Write one to eight int32."""
        self._align(4)
        self._data += _INT32[len(values)].pack(*values)

    def float64(self, values: Iterable[float]) -> None:
        """Write up to 63 float64."""
        packed = tuple(values)
        self._align(8)
        self._data += _DOUBLES[len(packed)].pack(*packed)

    def float32(self, value: float) -> None:
        """Write a float32."""
        self._align(4)
        self._data += _FLOAT32.pack(value)

    def boolean(self, *, value: bool) -> None:
        """Write a bool."""
        self._data.append(value)

    def byte(self, value: int) -> None:
        """Write a uint8, or a byte, the type in DiagnosticStatus."""
        self._data.append(value)

    def octets(self, data: bytes) -> None:
        """Write an array of uint8."""
        self._data += data

    def text(self, value: str) -> None:
        """Write a string."""
        encoded = value.encode()
        self.uint32(len(encoded) + 1)
        self._data += encoded
        self._data.append(0)

    def raw_float64(self, data: bytes) -> None:
        """Write bytes of float64, in memory order."""
        if data:
            self._align(8)
            self._data += data

    def time(self, stamp_ns: int) -> None:
        """Write a builtin_interfaces/Time."""
        self._align(4)
        self._data += _STAMP.pack(*divmod(stamp_ns, 1_000_000_000))

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Write a std_msgs/Header."""
        self.time(stamp_ns)
        self.text(frame_id)


# The small types common to all messages: Time, Header, points, quaternions, poses.

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


# Detects messages that repeat the last one of their topic, such as an unchanged calibration.


class LastKeys:
    """The keys of the last messages of topics; see Topic.change_key."""

    def __init__(self) -> None:
        self._keys: dict[int, Hashable] = {}

    def repeats(self, topic: int, key: Hashable) -> bool:
        """Return whether a message has the key of its topic's last one; its key is then the last.

        Messages without a key, None, never repeat.
        """
        if key is None:
            return False
        if self._keys.get(topic) == key:
            return True
        self._keys[topic] = key
        return False


# Check that the definition of a type in a bag has the required fields.
#
# Definitions differ between distributions, ROS 1 and forks. Additional fields are ignored; missing
# ones, or those of another kind, would cause errors later.


# Unused fields, or those with other names in other versions, which the decoders handle.
_OPTIONAL = {
    'livox_ros_driver/msg/CustomMsg': {'timebase', 'point_num', 'lidar_id', 'rsvd'},
    'livox_ros_driver/msg/CustomPoint': {'offset_time', 'tag', 'line'},
    'livox_ros_driver2/msg/CustomMsg': {'timebase', 'point_num', 'lidar_id', 'rsvd'},
    'livox_ros_driver2/msg/CustomPoint': {'offset_time', 'tag', 'line'},
    'velodyne_msgs/msg/VelodynePacket': {'stamp'},
    'nav_msgs/msg/Odometry': {'twist'},
    'sensor_msgs/msg/PointCloud2': {'is_dense'},
    'vision_msgs/msg/BoundingBox2D': {'center'},
    'vision_msgs/msg/Detection2D': {'id'},
    'vision_msgs/msg/Detection3D': {'id'},
    'vision_msgs/msg/ObjectHypothesisWithPose': {'hypothesis', 'pose'},
    'visualization_msgs/msg/Marker': {
        'lifetime',
        'frame_locked',
        'color',
        'points',
        'colors',
        'texture_resource',
        'texture',
        'uv_coordinates',
        'mesh_resource',
        'mesh_file',
        'mesh_use_embedded_materials',
    },
}
# Numbers that have other paths in other versions; all of one version are needed.
_VERSIONS = {
    'vision_msgs/msg/BoundingBox2D': (
        ('center.position.x', 'center.position.y', 'center.theta'),
        ('center.x', 'center.y', 'center.theta'),
    ),
}


def lacking_field(typestore: Typestore, msgtype: str) -> str:
    """Return the first missing field or one of another kind, such as header.stamp; empty for none.

    Types unknown to this package have no required fields.
    """
    if msgtype not in TYPESTORE.fielddefs:
        return ''
    if msgtype not in typestore.fielddefs:
        return msgtype
    fields = dict(typestore.fielddefs[msgtype][1])
    optional = _OPTIONAL.get(msgtype, set())
    for name, expected in TYPESTORE.fielddefs[msgtype][1]:
        if name in optional:
            continue
        if name not in fields or not _is_alike(fields[name], expected):
            return name
        inner = _lacking_within(typestore, fields[name])
        if inner:
            return f'{name}.{inner}'
    versions = _VERSIONS.get(msgtype, ())
    if not versions or any(
        all(_is_number(typestore, msgtype, path) for path in paths) for paths in versions
    ):
        return ''
    return versions[0][0]


def _is_number(typestore: Typestore, msgtype: str, path: str) -> bool:
    """Return whether a message has a number at a path such as center.x."""
    name, _, inner = path.partition('.')
    fields = dict(typestore.fielddefs[msgtype][1]) if msgtype in typestore.fielddefs else {}
    kind, detail = fields.get(name, (None, ''))
    if inner:
        nested = str(detail)
        return kind == Nodetype.NAME and _is_number(typestore, nested, inner)
    return kind == Nodetype.BASE and cast('tuple[Basename, int]', detail)[0] != 'string'


def _lacking_within(typestore: Typestore, field: FieldDesc) -> str:
    kind, detail = field
    if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        return _lacking_within(typestore, cast('tuple[FieldDesc, int]', detail)[0])
    return lacking_field(typestore, str(detail)) if kind == Nodetype.NAME else ''


def _is_alike(field: FieldDesc, expected: FieldDesc) -> bool:
    """Return whether both are numbers, texts, the same message, or arrays of these."""
    kind, detail = field
    if kind != expected[0]:
        return False
    if kind == Nodetype.BASE:
        names = [cast('tuple[Basename, int]', desc[1])[0] for desc in (field, expected)]
        return (names[0] == 'string') == (names[1] == 'string')
    if kind == Nodetype.NAME:
        return detail == expected[1]
    inner, size = cast('tuple[FieldDesc, int]', detail)
    expected_inner, expected_size = cast('tuple[FieldDesc, int]', expected[1])
    same_size = kind == Nodetype.SEQUENCE or size == expected_size
    return same_size and _is_alike(inner, expected_inner)
