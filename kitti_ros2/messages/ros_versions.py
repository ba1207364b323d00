# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Types and messages of ROS 1 as those of ROS 2, and back.

- std_msgs/Header has a seq in ROS 1, which rosbags' byte conversion handles: written as 0, and
  dropped in ROS 2.
- CameraInfo's D K R P of ROS 1 are named d k r p in ROS 2; the bytes are the same.
- Some types have other fields: Marker has texture, uv_coordinates and mesh_file in ROS 2 only.
  Messages of these are made anew, field by field.
- tf/tfMessage of ROS 1's first tf is tf2_msgs/msg/TFMessage in ROS 2, std_msgs/Time and Duration
  are those of builtin_interfaces, with the same bytes. rosgraph_msgs/Log is rcl_interfaces/msg/Log,
  with other numbers of levels, and without the topics of the node.
"""

from __future__ import annotations

from functools import lru_cache, partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import normalize_fieldname

from ..model.bag_formats import HEADER, TF
from .cdr import BULK_TAIL, join, split
from .ros_types import TYPESTORE
from .type_definitions import closure, lazy_typestore, nested_type

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from typing import TypeAlias

    from rosbags.interfaces.typing import Constdefs, Fielddefs, FieldDesc, Typesdict
    from rosbags.typesys.store import Typestore

    Parts: TypeAlias = Sequence[bytes | memoryview]
    Convert: TypeAlias = Callable[[Parts], Parts]

_LOG = 'rosgraph_msgs/msg/Log'
_TIMES = frozenset({'builtin_interfaces/msg/Time', 'builtin_interfaces/msg/Duration'})
RENAMED = {
    'tf/msg/tfMessage': TF,
    _LOG: 'rcl_interfaces/msg/Log',
    **{name.replace('builtin_interfaces', 'std_msgs'): name for name in _TIMES},
}
"""Types of ROS 1 that have another name in ROS 2."""

_LEVELS = {1: 10, 2: 20, 4: 30, 8: 40, 16: 50}
"""Levels of logs, from debug to fatal, of ROS 1 and ROS 2."""


@lru_cache(maxsize=1)
def jazzy_types() -> Typesdict:
    """Return the types of ROS 2 Jazzy, and those of definitions/."""
    # Loading all types of ROS 2 is slow, and most bags do not need it.
    return {**get_typestore(Stores.ROS2_JAZZY).fielddefs, **TYPESTORE.fielddefs}


# Messages by one definition of their type as messages by another.


class _Step(NamedTuple):
    """How a field is made: attribute, attribute of the source ('' for none), and its kind."""

    name: str
    source: str
    kind: Any


class Migration:
    """Makes messages by the definitions of one typestore of messages by those of another.

    Fields go by their names, whatever the case. One that the source lacks, or has as another kind
    of value, has its default: zero or empty.

    Args:
        source: Defines the messages that are given.
        target: Defines those that are made.

    Attributes:
        left_out: Fields of the messages so far that have a value and no place in the target.
    """

    def __init__(self, source: Typestore, target: Typestore) -> None:
        self._source, self._target = source, target
        self._plans: dict[str, tuple[list[_Step], Fielddefs]] = {}
        self._same: dict[str, bool] = {}
        self.left_out: set[str] = set()

    def same_layout(self, msgtype: str) -> bool:
        """Return whether messages of a type have the same bytes by both, but for ROS 1's seq."""
        if msgtype not in self._same:
            self._same[msgtype] = self._compare(msgtype)
        return self._same[msgtype]

    def _compare(self, msgtype: str) -> bool:
        made = RENAMED.get(msgtype, msgtype)
        if made == HEADER or made in _TIMES:
            return True
        source, target = self._source.fielddefs[msgtype][1], self._target.fielddefs[made][1]
        if len(source) != len(target):
            return False
        for (name, kind), (name_made, kind_made) in zip(source, target, strict=True):
            if name.lower() != name_made.lower() or kind != kind_made:
                return False
            nested = nested_type(kind)
            if nested is not None and not self.same_layout(nested):
                return False
        return True

    def rebuild(self, message: object, msgtype: str) -> Any:  # noqa: ANN401 - of the target's classes
        """Make a message.

        Args:
            message: Of the source; None makes one of defaults.
            msgtype: The name of its type in the source.

        Raises:
            Exception: A value does not fit.
        """
        if msgtype not in self._plans:
            self._plans[msgtype] = self._plan(msgtype)
        steps, dropped = self._plans[msgtype]
        if message is not None:
            self.left_out.update(
                f'{msgtype}.{name}'
                for name, kind in dropped
                if self._has_value(getattr(message, normalize_fieldname(name)), kind)
            )
        values = [
            self._value(getattr(message, step.source, None) if step.source else None, step)
            for step in steps
        ]
        return self._target.types[RENAMED.get(msgtype, msgtype)](*values)

    def _plan(self, msgtype: str) -> tuple[list[_Step], Fielddefs]:
        """Return the steps of a type, and the fields of the source that none of them takes."""
        made = RENAMED.get(msgtype, msgtype)
        source = self._source.fielddefs.get(msgtype, ((), ()))[1]
        by_name = {name.lower(): (name, kind) for name, kind in source}
        steps, taken = [], set()
        for name, kind in self._target.fielddefs[made][1]:
            own, own_kind = by_name.get(name.lower(), ('', None))
            is_taken = own_kind is not None and _is_compatible(own_kind, kind)
            if is_taken:
                taken.add(own)
            origin = normalize_fieldname(own) if is_taken else ''
            steps.append(_Step(normalize_fieldname(name), origin, kind))
        return steps, [member for member in source if member[0] not in taken]

    def _has_value(self, value: Any, kind: Any) -> bool:  # noqa: ANN401 - of a field of any kind
        """Return whether a field of the source has another value than the default."""
        if isinstance(value, np.ndarray):
            return bool(value.any())
        node, content = kind
        if node != Nodetype.NAME:
            return bool(value)
        return any(
            self._has_value(getattr(value, normalize_fieldname(name)), inner)
            for name, inner in self._source.fielddefs[content][1]
        )

    def _value(self, value: Any, step: _Step) -> Any:  # noqa: ANN401 - of any type
        node, content = step.kind
        if node == Nodetype.BASE:
            return _default(content[0]) if value is None else value
        if node == Nodetype.NAME:
            return self.rebuild(value, content)
        (element, inner), length = content
        count = length if node == Nodetype.ARRAY else 0
        if element == Nodetype.NAME:
            items = [None] * count if value is None else value
            return [self.rebuild(item, inner) for item in items]
        if inner[0] in _TEXTS:
            return [''] * count if value is None else value
        return np.zeros(count, _DTYPES.get(inner[0], inner[0])) if value is None else value


_TEXTS = frozenset({'string', 'wstring'})
_DTYPES = {'char': 'uint8', 'byte': 'uint8', 'octet': 'uint8'}


def _default(base: str) -> object:
    if base in _TEXTS:
        return ''
    return False if base == 'bool' else 0


def _is_compatible(source: FieldDesc, target: FieldDesc) -> bool:
    """Return whether values of one kind are values of another; nested messages are rebuilt."""
    (node, content), (node_made, content_made) = source, target
    if node == Nodetype.BASE:
        return node_made == node and content[0] == content_made[0]
    if node == Nodetype.NAME:
        return node_made == node and RENAMED.get(str(content), content) == content_made
    if node_made not in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        return False
    fits = node_made == Nodetype.SEQUENCE or (node == node_made and content[1] == content_made[1])
    return fits and _is_compatible(content[0], content_made[0])  # type: ignore[arg-type]


_NAMES_IN_ROS1 = {made: name for name, made in RENAMED.items() if made != TF}

# Conversion of ROS 2 messages to ROS 1: definitions, md5 sums and bytes.
#
# Types missing in Noetic's store (tf2_msgs, vision_msgs) keep ROS 2's fields with ROS 1's Header.
# For TFMessage this equals ROS 1's definition; Detection3DArray, which ROS 1 defined differently
# (class numbers instead of names), stays readable by the definition in the bag.


class Ros1Types:
    """The ROS 1 counterparts of the types in a ROS 2 typestore.

    Attributes:
        migration: Makes the messages of types whose fields differ.
    """

    def __init__(self, typestore: Typestore) -> None:
        self._ros2 = typestore
        self._ros1 = get_typestore(Stores.ROS1_NOETIC)
        self.migration = Migration(self._ros2, self._ros1)

    def name(self, msgtype: str) -> str:
        """Return the name of a type in ROS 1, in the spelling of ROS 2."""
        return _NAMES_IN_ROS1.get(msgtype, msgtype)

    def definition(self, msgtype: str) -> tuple[str, str]:
        """Return the text and the md5 sum of a type in ROS 1, by its name there."""
        self._complete(msgtype)
        return self._ros1.generate_msgdef(msgtype, ros_version=1)

    def converter(self, msgtype: str) -> Convert:
        """Return a function that converts the type's CDR to ROS 1's serialization."""
        self._complete(msgtype)
        if msgtype != RENAMED[_LOG] and self.migration.same_layout(msgtype):
            return partial(self._converted, msgtype)
        rebuild = self._rebuild_log if msgtype == RENAMED[_LOG] else self.migration.rebuild
        return lambda parts: (
            self._ros1.serialize_ros1(
                rebuild(self._ros2.deserialize_cdr(join(parts), msgtype), msgtype),
                self.name(msgtype),
            ),
        )

    def _converted(self, msgtype: str, parts: Parts) -> Parts:
        """Convert a message of the same fields; its bulk becomes a part of its own, not a copy."""
        head, *others = split(parts, msgtype)
        if not others:
            return (self._ros2.cdr_to_ros1(head, msgtype),)
        bulk, *ends = others
        tail = BULK_TAIL[msgtype]
        hollow = join((head[:-4], bytes(4), *ends))[: len(head) + tail]
        converted = self._ros2.cdr_to_ros1(hollow, msgtype)
        before = len(converted) - tail
        return converted[: before - 4], head[-4:], bulk, converted[before:]

    def _rebuild_log(self, log: Any, msgtype: str) -> Any:  # noqa: ANN401 - rosbags classes
        """Make a log of ROS 1, without the topics of the node."""
        types = self._ros1.types
        header = types[HEADER](0, log.stamp, '')
        level = next((own for own, ros2 in _LEVELS.items() if ros2 == log.level), log.level)
        values = log.name, log.msg, log.file, log.function, log.line
        return types[self.name(msgtype)](header, level, *values, [])

    def _complete(self, msgtype: str) -> None:
        defined = self._ros1.fielddefs
        types = {**self._ros2.fielddefs, **defined}
        missing = {name: types[name] for name in closure(types, msgtype) if name not in defined}
        if missing:
            self._ros1.register(missing)


# Conversion of ROS 1 messages, in CDR by the definitions of their bag, to ROS 2.


class Ros2Types:
    """The ROS 2 counterparts of the types of ROS 1 bags.

    Types that ROS 2 Jazzy has are Jazzy's. Others keep their fields, in lower case as ROS 2 demands
    it.

    Args:
        source: The types as the bags define them.
        kept: Types whose definitions stay, with those in them.

    Attributes:
        typestore: The counterparts.
        migration: Makes the messages of types whose fields differ.
    """

    def __init__(self, source: Typestore, kept: Collection[str]) -> None:
        own = source.fielddefs
        stay = set(chain.from_iterable(closure(own, name) for name in kept))
        types = {name: _in_lower_case(*definition) for name, definition in own.items()}
        types |= jazzy_types()
        types |= {name: own[name] for name in stay if name in own}
        self._source = source
        self.typestore: Typestore = lazy_typestore(types)
        self.migration = Migration(source, self.typestore)

    def converter(self, msgtype: str) -> Convert | None:
        """Return a function that converts the CDR of a type; None if it stays as it is."""
        if self.migration.same_layout(msgtype):
            return None
        made = RENAMED.get(msgtype, msgtype)
        rebuild = self._rebuild_log if msgtype == _LOG else self.migration.rebuild

        def convert(parts: Parts) -> Parts:
            message = self._source.deserialize_cdr(bytes(join(parts)), msgtype)
            return (self.typestore.serialize_cdr(rebuild(message, msgtype), made),)

        return convert

    def _rebuild_log(self, log: Any, msgtype: str) -> Any:  # noqa: ANN401 - rosbags classes
        """Make a log of ROS 2."""
        if log.topics:
            self.migration.left_out.add(f'{msgtype}.topics')
        level = _LEVELS.get(log.level, log.level)
        return self.typestore.types[RENAMED[msgtype]](
            log.header.stamp, level, log.name, log.msg, log.file, log.function, log.line
        )


def _in_lower_case(constants: Constdefs, fields: Fielddefs) -> tuple[Constdefs, Fielddefs]:
    """Return a definition with names as ROS 2 demands them: constants upper, fields lower case."""
    upper, lower = _cased(constants, str.upper), _cased(fields, str.lower)
    return (
        [(name, kind, value) for name, (_, kind, value) in zip(upper, constants, strict=True)],
        [(name, kind) for name, (_, kind) in zip(lower, fields, strict=True)],
    )


def _cased(members: Collection[Any], case: Callable[[str], str]) -> list[str]:
    """Return the names of members in upper or lower case, unless two would be the same."""
    names = [member[0] for member in members]
    cased = list(map(case, names))
    return cased if len(set(cased)) == len(names) else names
