# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The Python class of a message type for rclpy: the installed one, or one built at run time."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from ..messages.type_descriptions import (
    HASH_PREFIX,
    MESSAGE,
    MessageField,
    Shape,
    defined_hash,
    fields_of,
    references_of,
)
from ..model.errors import MissingDataError

if TYPE_CHECKING:
    from ..messages.ros_types import Typestore


# The C structures that describe a message type to the middleware, with the layout of ROS 2 Jazzy.
#
# Each names the header that it mirrors, member by member, without the trailing underscores of some
# member names. A test reads the types of an installed package through them, to detect a changed
# layout.

C_IDENTIFIER = b'rosidl_typesupport_c'
FASTRTPS_IDENTIFIER = b'rosidl_typesupport_fastrtps_c'
INTROSPECTION_IDENTIFIER = b'rosidl_typesupport_introspection_c'


class CString(ctypes.Structure):
    """rosidl_runtime_c__String of rosidl_runtime_c/string.h."""

    _fields_: ClassVar = [
        ('data', ctypes.c_char_p),
        ('size', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
    ]


class CSequence(ctypes.Structure):
    """A sequence of any type, with the layout of ROSIDL_RUNTIME_C__PRIMITIVE_SEQUENCE."""

    _fields_: ClassVar = [
        ('data', ctypes.c_void_p),
        ('size', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
    ]


class TypeHash(ctypes.Structure):
    """rosidl_type_hash_t of rosidl_runtime_c/type_hash.h."""

    _fields_: ClassVar = [('version', ctypes.c_uint8), ('value', ctypes.c_uint8 * 32)]


class FieldType(ctypes.Structure):
    """FieldType of rosidl_runtime_c/type_description/field_type__struct.h."""

    _fields_: ClassVar = [
        ('type_id', ctypes.c_uint8),
        ('capacity', ctypes.c_uint64),
        ('string_capacity', ctypes.c_uint64),
        ('nested_type_name', CString),
    ]


class Field(ctypes.Structure):
    """Field of rosidl_runtime_c/type_description/field__struct.h."""

    _fields_: ClassVar = [('name', CString), ('type', FieldType), ('default_value', CString)]


class IndividualTypeDescription(ctypes.Structure):
    """Type of rosidl_runtime_c/type_description/individual_type_description__struct.h."""

    _fields_: ClassVar = [('type_name', CString), ('fields', CSequence)]


class TypeDescription(ctypes.Structure):
    """TypeDescription of rosidl_runtime_c/type_description/type_description__struct.h."""

    _fields_: ClassVar = [
        ('type_description', IndividualTypeDescription),
        ('referenced_type_descriptions', CSequence),
    ]


class TypeSource(ctypes.Structure):
    """TypeSource of rosidl_runtime_c/type_description/type_source__struct.h."""

    _fields_: ClassVar = [
        ('type_name', CString),
        ('encoding', CString),
        ('raw_file_contents', CString),
    ]


class MessageTypeSupport(ctypes.Structure):
    """rosidl_message_type_support_t of rosidl_runtime_c/message_type_support_struct.h."""

    _fields_: ClassVar = [
        ('typesupport_identifier', ctypes.c_char_p),
        ('data', ctypes.c_void_p),
        ('func', ctypes.c_void_p),
        ('get_type_hash_func', ctypes.c_void_p),
        ('get_type_description_func', ctypes.c_void_p),
        ('get_type_description_sources_func', ctypes.c_void_p),
    ]


class MessageMember(ctypes.Structure):
    """Struct of rosidl_typesupport_introspection_c/message_introspection.h."""

    _fields_: ClassVar = [
        ('name', ctypes.c_char_p),
        ('type_id', ctypes.c_uint8),
        ('string_upper_bound', ctypes.c_size_t),
        ('members', ctypes.c_void_p),
        ('is_key', ctypes.c_bool),
        ('is_array', ctypes.c_bool),
        ('array_size', ctypes.c_size_t),
        ('is_upper_bound', ctypes.c_bool),
        ('offset', ctypes.c_uint32),
        ('default_value', ctypes.c_void_p),
        ('size_function', ctypes.c_void_p),
        ('get_const_function', ctypes.c_void_p),
        ('get_function', ctypes.c_void_p),
        ('fetch_function', ctypes.c_void_p),
        ('assign_function', ctypes.c_void_p),
        ('resize_function', ctypes.c_void_p),
    ]


class MessageMembers(ctypes.Structure):
    """Struct of rosidl_typesupport_introspection_c/message_introspection.h."""

    _fields_: ClassVar = [
        ('message_namespace', ctypes.c_char_p),
        ('message_name', ctypes.c_char_p),
        ('member_count', ctypes.c_uint32),
        ('size_of', ctypes.c_size_t),
        ('has_any_key_member', ctypes.c_bool),
        ('members', ctypes.c_void_p),
        ('init_function', ctypes.c_void_p),
        ('fini_function', ctypes.c_void_p),
    ]


class FastrtpsCallbacks(ctypes.Structure):
    """message_type_support_callbacks_t of rosidl_typesupport_fastrtps_cpp."""

    _fields_: ClassVar = [
        ('message_namespace', ctypes.c_char_p),
        ('message_name', ctypes.c_char_p),
        ('cdr_serialize', ctypes.c_void_p),
        ('cdr_deserialize', ctypes.c_void_p),
        ('get_serialized_size', ctypes.c_void_p),
        ('max_serialized_size', ctypes.c_void_p),
        ('key_callbacks', ctypes.c_void_p),
    ]


HandleFunction = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
"""rosidl_message_typesupport_handle_function: (handle, identifier) -> handle, or NULL."""

Getter = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
"""rosidl_message_get_type_{hash,description,description_sources}_function: (handle) -> pointer."""

_new_capsule = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p
)(('PyCapsule_New', ctypes.pythonapi))
_capsule_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ('PyCapsule_GetPointer', ctypes.pythonapi)
)


def wrap_pointer(address: int) -> object:
    """Wrap a pointer in a capsule without name, like the generated Python classes do."""
    return _new_capsule(address, None, None)


def unwrap_pointer(capsule: object) -> int:
    """Return the pointer in such a capsule."""
    return int(_capsule_pointer(capsule, None))


# The size of a message type in memory.

_MOST_FIELDS = 10_000  # with those of nested types; the largest in use have a thousand
_MOST_BYTES = 2**30
_MOST_LEVELS = 50

# By the kind of a field its number in rosidl_typesupport_introspection_c/field_types.h, and its
# type in C; None for a message.
_KINDS: dict[str, tuple[int, Any]] = {
    'float32': (1, ctypes.c_float),
    'float64': (2, ctypes.c_double),
    'bool': (6, ctypes.c_bool),
    'byte': (7, ctypes.c_uint8),
    'octet': (7, ctypes.c_uint8),
    'uint8': (8, ctypes.c_uint8),
    'int8': (9, ctypes.c_int8),
    'uint16': (10, ctypes.c_uint16),
    'int16': (11, ctypes.c_int16),
    'uint32': (12, ctypes.c_uint32),
    'int32': (13, ctypes.c_int32),
    'uint64': (14, ctypes.c_uint64),
    'int64': (15, ctypes.c_int64),
    'char': (8, ctypes.c_uint8),
    'string': (16, CString),
    'wstring': (17, CSequence),
    MESSAGE: (18, None),
}


def split_name(msgtype: str) -> tuple[str, str, str]:
    """Split a message type into package, folder (msg) and name."""
    package, folder, name = msgtype.split('/')
    return package, folder, name


def check_size(msgtype: str, typestore: Typestore) -> None:
    """Check that a type can be laid out in memory: ROS has no types that contain themselves.

    Raises:
        MissingDataError: It contains itself, is nested too deeply, or too large; or a definition is
            missing.
    """
    footprints: dict[str, _Footprint] = {}
    _measure(msgtype, typestore, footprints, ())


class _Footprint(NamedTuple):
    fields: int
    size_bytes: int


def _measure(
    msgtype: str, typestore: Typestore, footprints: dict[str, _Footprint], above: tuple[str, ...]
) -> _Footprint:
    if msgtype in above:
        raise MissingDataError(f'{msgtype}: the type contains itself')
    if len(above) > _MOST_LEVELS:
        raise MissingDataError(f'{above[0]}: its types are nested more than {_MOST_LEVELS} deep')
    if msgtype in footprints:
        return footprints[msgtype]
    fields, size_bytes = 0, 0
    for field in fields_of(msgtype, typestore):
        _, ctype = _KINDS[field.kind]
        inner = _Footprint(1, 0 if ctype is None else ctypes.sizeof(ctype))
        if field.nested:
            inner = _measure(field.nested, typestore, footprints, (*above, msgtype))
        fields += inner.fields
        size_bytes += inner.size_bytes * (field.length if field.shape == Shape.ARRAY else 1)
        if fields > _MOST_FIELDS or size_bytes > _MOST_BYTES:
            raise MissingDataError(
                f'{msgtype}: the type is too large, of more than {_MOST_FIELDS} fields or'
                f' {_MOST_BYTES} bytes'
            )
    footprints[msgtype] = _Footprint(fields, size_bytes)
    return footprints[msgtype]


# ROS message types built at run time, in place of the generated and compiled C libraries.
#
# Such a type is for serialised messages only. It gives the middleware its name, hash, fields and
# description, and the memory layout of a message; but no message is ever in memory, and the
# functions that would convert one report failure.

_DEPENDENCY_RULE = '=' * 80  # in a generated definition, precedes each dependency
_ENCAPSULATION_SIZE = 4

# The functions of generated code for messages in memory. No message ever is, so each of these only
# has to be safe to call: nothing is read, nothing but `bounds` is written.
_CONVERT_NOTHING = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_void_p)(
    lambda _message, _cdr: False
)
_NO_SIZE = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)(lambda _message: 0)
_NO_ELEMENTS = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_void_p)(lambda _member: 0)
_NO_ELEMENT = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)(
    lambda _member, _index: None
)
_COPY_NOTHING = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)(
    lambda _member, _index, _value: None
)
_RESIZE_NOTHING = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_size_t)(
    lambda _member, _size: False
)
_FREE_NOTHING = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda _message: None)
_INITIALIZE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int)


def _promise_no_bound(bounds: Any) -> int:  # noqa: ANN401 - a ctypes pointer
    """Report an unbounded message size, so that buffers grow with each message."""
    bounds[0] = b'\0'  # ROSIDL_TYPESUPPORT_FASTRTPS_UNBOUNDED_TYPE
    return _ENCAPSULATION_SIZE


_MAX_SIZE = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.POINTER(ctypes.c_char))(_promise_no_bound)

_SHARED = (
    *(_CONVERT_NOTHING, _NO_SIZE, _MAX_SIZE, _NO_ELEMENTS, _NO_ELEMENT, _COPY_NOTHING),
    *(_RESIZE_NOTHING, _FREE_NOTHING),
)


def _pointer(function: Any) -> int | None:  # noqa: ANN401 - one of many ctypes function types
    return ctypes.cast(function, ctypes.c_void_p).value


def _text(value: str) -> CString:
    """Make a C string; an empty one has no data, as in the generated code."""
    data = value.encode()
    return CString(data or None, len(data), len(data))


class RuntimeType:
    """The type support of one message type; owns all memory that C code reads through it.

    The middleware may keep the pointers forever, so an object of this class must never be freed:
    get it from `runtime_type`, which ensures that.

    Attributes:
        msgtype: The type's full name, such as tf2_msgs/msg/TFMessage.
        layout: The memory layout of a message.
        fields: Its fields, in order.
        nested: The types of its fields that are messages, by full name.
        capsule: The pointer to its type support, for rclpy.
    """

    def __init__(self, msgtype: str, typestore: Typestore) -> None:
        self.msgtype = msgtype
        self.fields = fields_of(msgtype, typestore)
        self.nested = {
            name: runtime_type(name, typestore)
            for name in dict.fromkeys(field.nested for field in self.fields if field.nested)
        }
        text = typestore.generate_msgdef(msgtype, ros_version=2)[0]
        self._definition = text.partition(_DEPENDENCY_RULE)[0]
        self.layout = self._make_layout()
        self._kept: list[object] = [*_SHARED]
        getters = self._make_getters(typestore)
        self._handles: dict[bytes, int] = {}
        dispatch = self._keep(HandleFunction(self._find_handle))
        for identifier, data in (
            (C_IDENTIFIER, None),
            (FASTRTPS_IDENTIFIER, self._make_fastrtps()),
            (INTROSPECTION_IDENTIFIER, self._make_introspection()),
        ):
            handle = MessageTypeSupport(identifier, data, _pointer(dispatch), *getters)
            self._handles[identifier] = self._address(handle)
        self.capsule = wrap_pointer(self._handles[C_IDENTIFIER])

    def handle(self, identifier: bytes) -> int:
        """Return the address of the type support of one kind."""
        return self._handles[identifier]

    def individual_description(self) -> IndividualTypeDescription:
        """Return the type's name and fields, without those of its dependencies."""
        described = [
            Field(
                name=_text(field.name),
                type=FieldType(
                    field.type_id,
                    field.length,
                    field.string_bound,
                    _text(field.nested),
                ),
            )
            for field in self.fields
        ]
        return IndividualTypeDescription(_text(self.msgtype), self._sequence(described))

    def source(self) -> TypeSource:
        """Return the text of the type's definition."""
        return TypeSource(_text(self.msgtype), _text('msg'), _text(self._definition))

    def _find_handle(self, _handle: int | None, identifier: bytes) -> int | None:
        """Answer a lookup; NULL makes a middleware of another kind report the error."""
        return self._handles.get(identifier)

    def _make_getters(self, typestore: Typestore) -> list[int | None]:
        """Make the functions that return the type's hash, description and sources."""
        type_hash = defined_hash(self.msgtype, typestore)
        names = references_of(self.msgtype, typestore)
        references = [runtime_type(name, typestore) for name in names]
        value = TypeHash(1)
        value.value[:] = bytes.fromhex(type_hash.removeprefix(HASH_PREFIX))
        description = TypeDescription(
            self.individual_description(),
            self._sequence([nested.individual_description() for nested in references]),
        )
        sources = self._sequence([self.source(), *(nested.source() for nested in references)])
        return [
            _pointer(self._keep(Getter(lambda _handle, address=address: address)))
            for address in map(self._address, (value, description, sources))
        ]

    def _make_layout(self) -> type[ctypes.Structure]:
        """Make the structure that the C generator would write."""
        members = []
        for field in self.fields:
            nested = self.nested.get(field.nested)
            element = nested.layout if nested else _KINDS[field.kind][1]
            if field.shape == Shape.ARRAY:
                element = element * field.length
            elif field.shape != Shape.ONE:
                element = CSequence
            members.append((field.name, element))
        return type(self.msgtype, (ctypes.Structure,), {'_fields_': members})

    def _make_fastrtps(self) -> int:
        package, folder, name = split_name(self.msgtype)
        return self._address(
            FastrtpsCallbacks(
                f'{package}::{folder}'.encode(),
                name.encode(),
                cdr_serialize=_pointer(_CONVERT_NOTHING),
                cdr_deserialize=_pointer(_CONVERT_NOTHING),
                get_serialized_size=_pointer(_NO_SIZE),
                max_serialized_size=_pointer(_MAX_SIZE),
            )
        )

    def _make_introspection(self) -> int:
        package, folder, name = split_name(self.msgtype)
        size = ctypes.sizeof(self.layout)
        members = (MessageMember * len(self.fields))(*map(self._make_member, self.fields))

        def clear(message: int, _initialization: int) -> None:
            ctypes.memset(message, 0, size)

        return self._address(
            MessageMembers(
                f'{package}__{folder}'.encode(),
                name.encode(),
                len(self.fields),
                size,
                members=self._address(members),
                init_function=_pointer(self._keep(_INITIALIZE(clear))),
                fini_function=_pointer(_FREE_NOTHING),
            )
        )

    def _make_member(self, field: MessageField) -> MessageMember:
        nested = self.nested.get(field.nested)
        member = MessageMember(
            field.name.encode(),
            _KINDS[field.kind][0],
            field.string_bound,
            nested.handle(INTROSPECTION_IDENTIFIER) if nested else None,
            is_array=field.shape != Shape.ONE,
            array_size=field.length,
            is_upper_bound=field.shape == Shape.BOUNDED,
            offset=getattr(self.layout, field.name).offset,
        )
        if field.shape != Shape.ONE:
            member.size_function = _pointer(_NO_ELEMENTS)
            member.get_const_function = member.get_function = _pointer(_NO_ELEMENT)
            member.fetch_function = member.assign_function = _pointer(_COPY_NOTHING)
            member.resize_function = _pointer(_RESIZE_NOTHING)
        return member

    def _sequence(self, items: list[Any]) -> CSequence:
        """Make a C sequence; an empty one has no data, as in the generated code."""
        if not items:
            return CSequence()
        array = (type(items[0]) * len(items))(*items)
        return CSequence(self._address(array), len(items), len(items))

    def _keep(self, thing: Any) -> Any:  # noqa: ANN401 - buffers and functions of every type
        self._kept.append(thing)
        return thing

    def _address(self, buffer: Any) -> int:  # noqa: ANN401 - as above
        return ctypes.addressof(self._keep(buffer))


_TYPES: dict[tuple[str, str], RuntimeType] = {}


def runtime_type(msgtype: str, typestore: Typestore) -> RuntimeType:
    """Return the only object for a message type with this definition; made at the first call."""
    key = (msgtype, defined_hash(msgtype, typestore))
    if key not in _TYPES:
        new_type = RuntimeType(msgtype, typestore)
        if _TYPES.setdefault(key, new_type) is new_type:
            # Kept beyond the end of this module: the middleware outlives it.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(new_type))
    return _TYPES[key]


__all__ = ['message_class', 'type_hash']

_CLASSES: dict[tuple[str, str], type] = {}


class RawOnly:
    """A placeholder for the functions of a generated class that convert messages to or from C."""


def message_class(msgtype: str, typestore: Typestore) -> type:
    """Return the class for a publisher, or for a subscription with raw=True.

    It is the class of the installed package if the typestore has the same definition; without such
    a package, a class built at run time. Its instances are empty: publish bytes.

    Args:
        msgtype: The type's full name, such as tf2_msgs/msg/TFMessage.
        typestore: Contains the definition that the messages are serialised by.

    Returns:
        The same class for the same definition.

    Raises:
        MissingDataError: The type is unknown or too large, or its installed package is broken or
            differs.
    """
    check_size(msgtype, typestore)
    key = (msgtype, defined_hash(msgtype, typestore))
    if key not in _CLASSES:
        cls = _installed_class(*key) or _runtime_class(msgtype, typestore)
        return _CLASSES.setdefault(key, cls)
    return _CLASSES[key]


def type_hash(cls: type) -> str:
    """Return the type hash of a message class, RIHS01_ and 64 hexadecimal digits.

    Raises:
        MissingDataError: The class is not a ROS 2 message, or its package's libraries are missing.
    """
    metaclass: Any = type(cls)
    try:
        if metaclass._TYPE_SUPPORT is None:  # noqa: SLF001 - as rclpy itself does
            metaclass.__import_type_support__()
        address = unwrap_pointer(metaclass._TYPE_SUPPORT)  # noqa: SLF001 - as above
    except Exception as error:  # a broken installation may raise anything
        raise MissingDataError(
            f'{cls.__module__}.{cls.__name__}: the installed package does not work with ROS 2'
            f' ({error}); install it again, or remove it from PYTHONPATH'
        ) from error
    support = MessageTypeSupport.from_address(address)
    rihs = TypeHash.from_address(Getter(support.get_type_hash_func)(address))
    return f'RIHS{rihs.version:02}_{bytes(rihs.value).hex()}'


def _installed_class(msgtype: str, expected: str) -> type | None:
    package, folder, name = split_name(msgtype)
    try:
        module = importlib.import_module(f'{package}.{folder}')
    except ModuleNotFoundError as error:
        if error.name not in {package, f'{package}.{folder}'}:
            raise MissingDataError(
                f'{msgtype}: the installed package {package} cannot be imported ({error});'
                f' install its dependencies, or remove it from PYTHONPATH'
            ) from error
        return None
    if importlib.util.find_spec('type_description_interfaces') is None:
        # Its type supports contain no hash, and reading one would crash.
        raise MissingDataError(
            f'{msgtype}: the installed package {package} is of a ROS 2 older than Jazzy;'
            f' use Jazzy or newer, or remove it from PYTHONPATH'
        )
    cls: type | None = getattr(module, name, None)
    if cls is not None and (own_hash := type_hash(cls)) != expected:
        raise MissingDataError(
            f'{msgtype}: the installed package {package} defines it differently ({own_hash}) than'
            f' ROS 2 Jazzy and Kilted ({expected}); install theirs, or remove it from PYTHONPATH'
        )
    return cls


def _runtime_class(msgtype: str, typestore: Typestore) -> type:
    """Build a class whose metaclass has the attributes that rclpy reads."""
    package, folder, name = split_name(msgtype)
    built = runtime_type(msgtype, typestore)
    raw_only = RawOnly()
    metaclass: Any = type(
        f'Metaclass_{name}',
        (type,),
        {
            '_TYPE_SUPPORT': built.capsule,
            '_CREATE_ROS_MESSAGE': raw_only,
            '_CONVERT_FROM_PY': raw_only,
            '_CONVERT_TO_PY': raw_only,
            '_DESTROY_ROS_MESSAGE': raw_only,
        },
    )
    body = {
        '__module__': f'{package}.{folder}',
        '__doc__': f'{msgtype}, built at run time: for serialised messages only.',
        '__slots__': (),
        'runtime_type': built,
    }
    cls: type = metaclass(name, (), body)
    return cls
