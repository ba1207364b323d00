# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Definitions of message types: texts, the files in definitions/, and typestores made from them."""

from __future__ import annotations

import re
import struct
from functools import partial
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, cast

import rosbags.typesys  # noqa: F401 - whole, before its modules: else threads wait in a circle
from rosbags.interfaces import Nodetype
from rosbags.serde import cdr, ros1
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore
from rosbags.typesys.stores import empty

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosbags.interfaces import Msgdef
    from rosbags.interfaces.typing import (
        BaseDesc,
        Basename,
        Constdefs,
        Fielddefs,
        FieldDesc,
        NameDesc,
        Typesdict,
    )


# Definitions of message types that consist of plain lines, as nearly all do.
#
# rosbags reads every text that ROS does, at 0.25 MB/s; these are read ten times as fast.

_INTEGERS = {'byte', 'char'} | {f'{sign}int{n}' for sign in ('', 'u') for n in (8, 16, 32, 64)}
_BASES = {'bool', 'float32', 'float64', 'string', *_INTEGERS}
_WITHOUT_PACKAGE = {
    'Header': 'std_msgs/msg/Header',
    'time': 'builtin_interfaces/msg/Time',
    'duration': 'builtin_interfaces/msg/Duration',
}
_DIVIDER = '\n' + '=' * 80 + '\nMSG: '
_HEAD = re.compile(r'([A-Za-z0-9_]+)/(?:(msg|action)/)?([A-Za-z0-9_]+)[ \t]*')
_LINE = re.compile(
    r'[ \t]*([A-Za-z][A-Za-z0-9_/]*)'
    r'(\[(?:(<=)?([1-9][0-9]{0,9}))?\])?'
    r'[ \t]+([A-Za-z][A-Za-z0-9_]*)'
    r'(?:[ \t]*=[ \t]*(0|-?[1-9][0-9]{0,18}))?[ \t]*(?:#.*)?'
)
_CONSTANT = re.compile(r'[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)*')
_MESSAGE = re.compile(r'(?:[a-z][a-z0-9]*(?:_[a-z0-9]+)*/)*[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*')


def parse_plain(msgtype: str, text: str) -> Typesdict | None:
    """Parse fields without defaults and constants that are decimal integers.

    Args:
        msgtype: The first type.
        text: In the format of .msg, without empty lines and lines of comments; the definitions of
            other types follow as in rosbag2.

    Returns:
        What get_types_from_msg of rosbags returns; None if there is anything else in the text.
    """
    types: Typesdict = {}
    for block in f'{msgtype}\n{text}'.rstrip('\n').split(_DIVIDER):
        first, *lines = block.split('\n')
        head = _HEAD.fullmatch(first)
        if head is None or head[1] in {'msg', 'action'}:
            return None
        package = f'{head[1]}/{head[2] or "msg"}'
        constants: Constdefs = []
        fields: Fielddefs = []
        for line in lines:
            if not _enter(line, package, constants, fields):
                return None
        types[f'{package}/{head[3]}'] = (constants, fields)
    return types


def _enter(line: str, package: str, constants: Constdefs, fields: Fielddefs) -> bool:
    """Enter what a line defines; return whether it is plain."""
    match = _LINE.fullmatch(line)
    if match is None:
        return False
    kind, brackets, bound, length, name, value = match.groups()
    if value is not None:
        if kind not in _INTEGERS or brackets or not _CONSTANT.fullmatch(name):
            return False
        constants.append((name, cast('Basename', kind), int(value)))
        return True
    element: BaseDesc | NameDesc
    if kind in _BASES:
        element = (Nodetype.BASE, (cast('Basename', kind), 0))
    elif _MESSAGE.fullmatch(kind):
        element = (Nodetype.NAME, _full_name(kind, package))
    else:
        return False
    described: FieldDesc = element
    if brackets:
        size = int(length or 0)
        is_array = size and not bound
        described = (Nodetype.ARRAY if is_array else Nodetype.SEQUENCE, (element, size))
    fields.append((name, described))
    return True


def _full_name(name: str, package: str) -> str:
    name = _WITHOUT_PACKAGE.get(name, name)
    other, slash, own = name.rpartition('/')
    if not slash:
        return f'{package}/{name}'
    return name if '/msg/' in name or '/action/' in name else f'{other}/msg/{own}'


# Wide strings, which rosbags cannot read: a type of its own takes the place of each.
#
# rosidl_typesupport_fastrtps of Jazzy and Kilted writes a wstring as the number of its UTF-16 code
# units, then each as a uint32, without a terminator: the bytes of a message with one uint32[].

_WIDE_STRING = re.compile(r'rosidl_runtime_c/msg/U16String([0-9]*)')
_WIDE_FIELD = re.compile(
    r'^[ \t]*wstring(?:<=(\d+))?(\[[^\]\n]*\])?[ \t]+(\w+)[ \t]*(=?).*$', re.MULTILINE
)


def without_wide_fields(text: str) -> str:
    """Return a text of messages with the type of a wide string in place of each wstring.

    Constants and defaults of this type are dropped.
    """
    return _WIDE_FIELD.sub(
        lambda field: '' if field[4] else f'{_wide_string(field[1])}{field[2] or ""} {field[3]}',
        text,
    )


def _wide_string(bound: object) -> str:
    return f'rosidl_runtime_c/msg/U16String{bound or ""}'


def wide_string_bound(msgtype: str) -> int | None:
    """Return the bound of a wide string's type, 0 for none; None for other types."""
    match = _WIDE_STRING.fullmatch(msgtype)
    return int(match[1] or 0) if match else None


_WIDE_BLOCK = re.compile(r'={80}\nMSG: rosidl_runtime_c/U16String[0-9]*\nuint32\[\] units\n')
_WIDE_NAME = re.compile(r'^rosidl_runtime_c/U16String([0-9]*)', re.MULTILINE)


def with_wide_names(text: str) -> str:
    """Return a text that was made of types with wide strings, as ROS 2 writes them: wstring."""
    without = _WIDE_BLOCK.sub('', text)
    return _WIDE_NAME.sub(lambda name: f'wstring{"<=" * bool(name[1])}{name[1]}', without)


def with_wide_strings(types: Typesdict) -> Typesdict:
    """Return types with that of a wide string in place of each wstring, and these types."""
    replaced: Typesdict = {
        name: (constants, [(field, _without_wide(kind)) for field, kind in fields])
        for name, (constants, fields) in types.items()
    }
    units: FieldDesc = (Nodetype.SEQUENCE, ((Nodetype.BASE, ('uint32', 0)), 0))
    inner = {nested_type(kind) for _, fields in replaced.values() for _, kind in fields}
    wide = [name for name in inner if name and wide_string_bound(name) is not None]
    return {**replaced, **{name: ([], [('units', units)]) for name in sorted(wide)}}


def _without_wide(described: FieldDesc) -> FieldDesc:
    kind, content = described
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        element, size = cast('tuple[BaseDesc | NameDesc, int]', content)
        return cast('FieldDesc', (kind, (_without_wide(element), size)))
    if kind == Nodetype.BASE and content[0] == 'wstring':
        return (Nodetype.NAME, _wide_string(content[1]))
    return described


def _read_wide_string(
    order: str, data: bytes, position: int, _cls: type, _store: Typestore
) -> tuple[str, int]:
    """Read one; the arguments are those of a function that rosbags makes.

    Raises:
        struct.error: It is longer than the message, or has a number above 16 bits.
    """
    (count,) = struct.unpack_from(f'{order}I', data, position)
    position += 4
    units = struct.unpack_from(f'{order}{count}I', data, position)
    text = struct.pack(f'<{count}H', *units).decode('utf-16-le', 'surrogatepass')
    return text, position + 4 * count


# Definitions of message types, of short texts and the files in definitions/; what is in them.

_FOLDER = Path(__file__).with_name('definitions')
_TYPE = '\nMSG: '
"""Precedes each type in a file, as in the definitions that bags contain."""


def closure(types: Typesdict, msgtype: str) -> Iterator[str]:
    """Yield a type and those in it, each once, including undefined ones."""
    waiting, seen = [msgtype], {msgtype}
    while waiting:
        name = waiting.pop()
        yield name
        for _, description in types[name][1] if name in types else ():
            nested = nested_type(description)
            if nested is not None and nested not in seen:
                seen.add(nested)
                waiting.append(nested)


def nested_type(description: Any) -> str | None:  # noqa: ANN401 - as rosbags has it
    """Return the message type of a field or its elements; None for numbers and strings."""
    kind, content = description
    if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return nested_type(content[0])
    return content if kind == Nodetype.NAME else None


OF_KITTI = 'kitti.msgs'
"""The file with the types of KITTI's data."""


def read_definitions(files: str = '*.txt') -> Typesdict:
    """Read the types in files of definitions/, those of others unless their name is given."""
    types: Typesdict = {}
    for path in sorted(_FOLDER.glob(files)):
        for block in path.read_text('utf-8').split(_TYPE)[1:]:
            msgtype, _, lines = block.strip().partition('\n')
            parsed = parse_plain(msgtype, lines)
            if parsed is None:
                raise ValueError(f'{msgtype} has a line that is not plain')
            types.update(parsed)
    return types


# Typestores that make the classes and functions of types when a message first needs them.
#
# rosbags makes all of a type at once, in 3 ms and 30 kB: a class, and 12 functions of which a
# reader needs one. A bag may define tens of thousands of types, and every command that opens one
# waits.


class LazyClasses(dict[str, Any]):
    """The Python classes of types.

    Args:
        registered: Classes that exist already.
        definitions: Definitions of all types.
    """

    def __init__(self, registered: Mapping[str, Any], definitions: Typesdict) -> None:
        super().__init__(registered)
        self._definitions = definitions
        self._lock = Lock()  # a type has one class, whichever threads ask for it

    def __missing__(self, msgtype: str) -> Any:  # noqa: ANN401 - classes of rosbags
        with self._lock:
            if msgtype not in self:
                needed = [name for name in closure(self._definitions, msgtype) if name not in self]
                store = Typestore()
                store.register({name: self._definitions[name] for name in needed})
                self.update(store.types)
        return self[msgtype]


class LazyClass:
    """A class that is made when its first message is; its constants are there before.

    Args:
        store: Defines the type.
        msgtype: Its name.
    """

    def __init__(self, store: Typestore, msgtype: str) -> None:
        self.__msgtype__ = msgtype
        self._classes = store.types
        for name, _, value in store.fielddefs[msgtype][0]:
            setattr(self, name, value)

    def __call__(self, *values: Any, **named: Any) -> Any:  # noqa: ANN401 - rosbags classes
        """Make a message."""
        return self._classes[self.__msgtype__](*values, **named)


class LazyFunctions:
    """The functions of a type, with the attributes of rosbags.interfaces.Msgdef.

    Args:
        name: The type.
        store: Defines it and those in it.

    Raises:
        KeyError: It does not.
    """

    def __init__(self, name: str, store: Typestore) -> None:
        self.name = name
        self.fields = [
            (normalize_fieldname(field), kind) for field, kind in store.fielddefs[name][1]
        ]
        self.store = store

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - functions, sizes and a class
        if name not in _MADE:
            raise AttributeError(name)
        made = _MADE if wide_string_bound(self.name) is None else {**_MADE, **_READ_WIDE_STRING}
        attribute = self.__dict__[name] = made[name](self)
        return attribute


def _converter(generate: Callable[..., object], of: LazyFunctions, *, copy: bool) -> object:
    return generate(of.fields, of.name, of.store, copy=copy)


_MADE: dict[str, Callable[[LazyFunctions], object]] = {
    'cls': lambda of: of.store.types[of.name],
    'cdr_sizes': lambda of: cdr.generate_getsize_cdr(of.fields, of.store),
    'getsize_cdr': lambda of: of.cdr_sizes[0],
    'size_cdr': lambda of: of.cdr_sizes[1],
    'serialize_cdr_le': lambda of: cdr.generate_serialize_cdr(of.fields, of.store, 'le'),
    'serialize_cdr_be': lambda of: cdr.generate_serialize_cdr(of.fields, of.store, 'be'),
    'deserialize_cdr_le': lambda of: cdr.generate_deserialize_cdr(of.fields, of.store, 'le'),
    'deserialize_cdr_be': lambda of: cdr.generate_deserialize_cdr(of.fields, of.store, 'be'),
    'ros1_sizes': lambda of: ros1.generate_getsize_ros1(of.fields, of.store),
    'getsize_ros1': lambda of: of.ros1_sizes[0],
    'size_ros1': lambda of: of.ros1_sizes[1],
    'serialize_ros1': lambda of: ros1.generate_serialize_ros1(of.fields, of.store),
    'deserialize_ros1': lambda of: ros1.generate_deserialize_ros1(of.fields, of.store),
    'getsize_ros1_to_cdr': partial(_converter, ros1.generate_ros1_to_cdr, copy=False),
    'ros1_to_cdr': partial(_converter, ros1.generate_ros1_to_cdr, copy=True),
    'getsize_cdr_to_ros1': partial(_converter, ros1.generate_cdr_to_ros1, copy=False),
    'cdr_to_ros1': partial(_converter, ros1.generate_cdr_to_ros1, copy=True),
}

_READ_WIDE_STRING: dict[str, Callable[[LazyFunctions], object]] = {
    'deserialize_cdr_le': lambda _: partial(_read_wide_string, '<'),
    'deserialize_cdr_be': lambda _: partial(_read_wide_string, '>'),
}


class LazyTypestore(Typestore):
    """A typestore whose functions are made when they are needed."""

    def get_msgdef(self, typename: str) -> Msgdef[object]:
        """Return the functions of a type.

        Raises:
            KeyError: It is not defined.
        """
        if typename not in self.cache:
            self.cache[typename] = cast('Msgdef[object]', LazyFunctions(typename, self))
        return self.cache[typename]


def lazy_typestore(types: Typesdict) -> LazyTypestore:
    """Make a store of types, and of Time and Duration."""
    store = LazyTypestore(empty)
    store.fielddefs = {**types, **store.fielddefs}
    store.types = LazyClasses(store.types, store.fielddefs)
    return store


# How much a message type holds at least: definitions of a few lines may hold 2^60 fields.

_MOST_FIELDS = 1_000_000
_MOST_LEVELS = 100


def check_extent(msgtype: str, fielddefs: Mapping[str, Any]) -> None:
    """Check that a type can be read: code for it visits each field, and recurses by levels.

    Sequences may be empty; arrays are not.

    Args:
        msgtype: Its full name.
        fielddefs: Definitions as rosbags has them. Types that are missing count nothing.

    Raises:
        ValueError: It holds too many fields, or itself.
    """
    _fields_of(msgtype, fielddefs, {}, ())


def _fields_of(
    msgtype: str, fielddefs: Mapping[str, Any], counts: dict[str, int], above: tuple[str, ...]
) -> int:
    if msgtype in counts:
        return counts[msgtype]
    if msgtype in above or len(above) > _MOST_LEVELS:
        raise ValueError(f'{(*above, msgtype)[0]} holds types that hold themselves, or too deeply')
    count = 0
    for _, (kind, rest) in fielddefs.get(msgtype, ((), ()))[1]:
        length, element, inner = 1, kind, rest
        if kind in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
            (element, inner), size = rest
            length = size if kind is Nodetype.ARRAY else 1
        fields = 1
        if element is Nodetype.NAME:
            fields += length * _fields_of(inner, fielddefs, counts, (*above, msgtype))
        count += fields
        if count > _MOST_FIELDS:
            raise ValueError(f'{msgtype} holds more than {_MOST_FIELDS} fields')
    counts[msgtype] = count
    return count
