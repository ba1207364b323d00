# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of a message type, from the typestore's definition, with the type numbers of ROS 2.

And their hash as defined by REP-2011.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from ..model.errors import MissingDataError
from .rosidl_structs import CSequence, CString

if TYPE_CHECKING:
    from ..messages.ros_types import Typestore

HASH_PREFIX = 'RIHS01_'

_MESSAGE = 'message'
_MOST_FIELDS = 10_000  # with those of nested types; the largest in use have a thousand
_MOST_BYTES = 2**30
_MOST_LEVELS = 50
_BOUNDED = 4  # from an unbounded string's number to a bounded one's in FieldType

# By rosbags' name of a kind of field: its number in rosidl_typesupport_introspection_c/
# field_types.h, its number in type_description_interfaces/msg/FieldType, and its type in C.
_KINDS: dict[str, tuple[int, int, Any]] = {
    'float32': (1, 10, ctypes.c_float),
    'float64': (2, 11, ctypes.c_double),
    'bool': (6, 15, ctypes.c_bool),
    'byte': (7, 16, ctypes.c_uint8),
    'octet': (7, 16, ctypes.c_uint8),
    'uint8': (8, 3, ctypes.c_uint8),
    'int8': (9, 2, ctypes.c_int8),
    'uint16': (10, 5, ctypes.c_uint16),
    'int16': (11, 4, ctypes.c_int16),
    'uint32': (12, 7, ctypes.c_uint32),
    'int32': (13, 6, ctypes.c_int32),
    'uint64': (14, 9, ctypes.c_uint64),
    'int64': (15, 8, ctypes.c_int64),
    'char': (8, 3, ctypes.c_uint8),  # in a .msg file it is a uint8
    'string': (16, 17, CString),
    'wstring': (17, 18, CSequence),
    _MESSAGE: (18, 1, None),
}


class Shape(IntEnum):
    """The kind of array of a field; the value is the offset in the numbers of FieldType."""

    ONE = 0
    ARRAY = 48
    BOUNDED = 96
    UNBOUNDED = 144


@dataclass(frozen=True)
class MessageField:
    """One field of a message.

    Attributes:
        name: The field's name.
        kind: The kind of its element: a primitive's name, or 'message'.
        nested: The element's full type name if it is a message, else empty.
        string_bound: Maximum length of a string; 0 is no bound.
        shape: Whether it is one element, an array or a sequence.
        length: An array's length or a bounded sequence's bound, else 0.
    """

    name: str
    kind: str
    nested: str = ''
    string_bound: int = 0
    shape: Shape = Shape.ONE
    length: int = 0

    @property
    def introspection_id(self) -> int:
        """The element's number for introspection."""
        return _KINDS[self.kind][0]

    @property
    def description_id(self) -> int:
        """The field's number in a type description."""
        return _KINDS[self.kind][1] + (_BOUNDED if self.string_bound else 0) + self.shape

    @property
    def ctype(self) -> Any:  # noqa: ANN401 - ctypes' own metaclasses
        """The element's type in C; None for a message."""
        return _KINDS[self.kind][2]


def split_name(msgtype: str) -> tuple[str, str, str]:
    """Split a message type into package, folder (msg) and name."""
    package, folder, name = msgtype.split('/')
    return package, folder, name


def fields_of(msgtype: str, typestore: Typestore) -> list[MessageField]:
    """Return the fields of a message type; as in C, an empty message has a filler."""
    if msgtype not in typestore.fielddefs:
        raise MissingDataError(f'{msgtype}: the definition of this message type is missing')
    described = typestore.fielddefs[msgtype][1]
    if not described:
        return [MessageField('structure_needs_at_least_one_member', 'uint8')]
    return [_parse(msgtype, name, *description) for name, description in described]


def references_of(msgtype: str, typestore: Typestore) -> list[str]:
    """Return all types that a message type refers to, directly or not, sorted by name."""
    found: set[str] = set()
    waiting = [msgtype]
    while waiting:
        nested = {field.nested for field in fields_of(waiting.pop(), typestore) if field.nested}
        waiting += nested - found
        found |= nested
    return sorted(found)


def check_size(msgtype: str, typestore: Typestore) -> None:
    """Check that a type can be laid out in memory: ROS has no types that contain themselves.

    Raises:
        MissingDataError: It contains itself, is nested too deeply, or too large; or a definition is
            missing.
    """
    known: dict[str, _Footprint] = {}
    _measure(msgtype, typestore, known, ())


class _Footprint(NamedTuple):
    fields: int
    size_bytes: int


def _measure(
    msgtype: str, typestore: Typestore, known: dict[str, _Footprint], above: tuple[str, ...]
) -> _Footprint:
    if msgtype in above:
        raise MissingDataError(f'{msgtype}: the type contains itself')
    if len(above) > _MOST_LEVELS:
        raise MissingDataError(f'{above[0]}: its types are nested more than {_MOST_LEVELS} deep')
    if msgtype in known:
        return known[msgtype]
    fields, size_bytes = 0, 0
    for field in fields_of(msgtype, typestore):
        inner = _Footprint(1, 0 if field.ctype is None else ctypes.sizeof(field.ctype))
        if field.nested:
            inner = _measure(field.nested, typestore, known, (*above, msgtype))
        fields += inner.fields
        size_bytes += inner.size_bytes * (field.length if field.shape == Shape.ARRAY else 1)
        if fields > _MOST_FIELDS or size_bytes > _MOST_BYTES:
            raise MissingDataError(
                f'{msgtype}: the type is too large, of more than {_MOST_FIELDS} fields or'
                f' {_MOST_BYTES} bytes'
            )
    known[msgtype] = _Footprint(fields, size_bytes)
    return known[msgtype]


def defined_hash(msgtype: str, typestore: Typestore) -> str:
    """Compute the type hash, RIHS01_ and 64 hexadecimal digits, of the typestore's definition.

    rosbags' own hash differs for types with a char (in ROS a uint8) or a wstring.
    """
    description = {
        'type_description': _hashed(msgtype, typestore),
        'referenced_type_descriptions': [
            _hashed(name, typestore) for name in references_of(msgtype, typestore)
        ],
    }
    return HASH_PREFIX + hashlib.sha256(json.dumps(description).encode()).hexdigest()


def _hashed(msgtype: str, typestore: Typestore) -> dict[str, object]:
    """Return the hashed description of one type, in the order of REP-2011."""
    return {
        'type_name': msgtype,
        'fields': [
            {
                'name': field.name,
                'type': {
                    'type_id': field.description_id,
                    'capacity': field.length,
                    'string_capacity': field.string_bound,
                    'nested_type_name': field.nested,
                },
            }
            for field in fields_of(msgtype, typestore)
        ],
    }


def _parse(msgtype: str, name: str, node: Any, rest: Any) -> MessageField:  # noqa: ANN401
    """Parse a field's type: its kind (BASE, NAME, ARRAY or SEQUENCE) and what that kind needs."""
    shape, length = Shape.ONE, 0
    if node.name in {'ARRAY', 'SEQUENCE'}:
        (node_of_element, rest_of_element), length = rest
        shape = Shape.BOUNDED if length else Shape.UNBOUNDED
        shape = Shape.ARRAY if node.name == 'ARRAY' else shape
        node, rest = node_of_element, rest_of_element
    if node.name == 'NAME':
        return MessageField(name, _MESSAGE, nested=rest, shape=shape, length=length)
    kind, string_bound = rest
    if kind not in _KINDS:
        raise MissingDataError(
            f'{msgtype}: its field {name} is a {kind}, unsupported in types built at run time;'
            f' install the package {split_name(msgtype)[0]}'
        )
    return MessageField(name, kind, string_bound=string_bound, shape=shape, length=length)
