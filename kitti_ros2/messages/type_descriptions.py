# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of a message type with the numbers of ROS 2, and their hash as defined by REP-2011."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from enum import IntEnum
from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING, Any

from ..model.errors import MissingDataError
from .type_definitions import wide_string_bound

if TYPE_CHECKING:
    from .ros_types import Typestore

HASH_PREFIX = 'RIHS01_'
MESSAGE = 'message'
"""The kind of a field that is a message."""

_BOUNDED = 4  # from an unbounded string's number to a bounded one's

# By rosbags' name of a kind of field its number in type_description_interfaces/msg/FieldType.
_TYPE_IDS = {
    MESSAGE: 1,
    'int8': 2,
    'uint8': 3,
    'char': 3,  # in a .msg file it is a uint8
    'int16': 4,
    'uint16': 5,
    'int32': 6,
    'uint32': 7,
    'int64': 8,
    'uint64': 9,
    'float32': 10,
    'float64': 11,
    'bool': 15,
    'byte': 16,
    'octet': 16,
    'string': 17,
    'wstring': 18,
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
    def type_id(self) -> int:
        """The field's number in a type description."""
        return _TYPE_IDS[self.kind] + (_BOUNDED if self.string_bound else 0) + self.shape


def fields_of(msgtype: str, typestore: Typestore) -> list[MessageField]:
    """Return the fields of a message type; as in C, an empty message has a filler."""
    if msgtype not in typestore.fielddefs:
        raise MissingDataError(f'{msgtype}: the definition of this message type is missing')
    described = typestore.fielddefs[msgtype][1]
    if not described:
        return [MessageField('structure_needs_at_least_one_member', 'uint8')]
    return [_parse(msgtype, name, *description) for name, description in described]


def references_of(msgtype: str, typestore: Typestore) -> list[str]:
    """Return all types that a message type refers to, directly or not, sorted by name.

    Raises:
        RecursionError: A type contains itself.
    """
    nested: dict[str, set[str]] = {}
    waiting = [msgtype]
    while waiting:
        name = waiting.pop()
        if name not in nested:
            nested[name] = {field.nested for field in fields_of(name, typestore) if field.nested}
            waiting += nested[name]
    try:
        TopologicalSorter(nested).prepare()
    except CycleError:
        raise RecursionError(f'{msgtype}: its definition refers to itself') from None
    return sorted(nested.keys() - {msgtype})


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
                    'type_id': field.type_id,
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
    bound = wide_string_bound(rest) if node.name == 'NAME' else None
    if bound is not None:
        return MessageField(name, 'wstring', string_bound=bound, shape=shape, length=length)
    if node.name == 'NAME':
        return MessageField(name, MESSAGE, nested=rest, shape=shape, length=length)
    kind, string_bound = rest
    if kind not in _TYPE_IDS:
        raise MissingDataError(
            f'{msgtype}: its field {name} is a {kind}, unsupported in types built at run time;'
            f' install the package {msgtype.partition("/")[0]}'
        )
    return MessageField(name, kind, string_bound=string_bound, shape=shape, length=length)
