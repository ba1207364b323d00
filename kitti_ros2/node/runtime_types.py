# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS message types built at run time, in place of the generated and compiled C libraries.

Such a type is for serialised messages only. It gives the middleware its name, hash, fields and
description, and the memory layout of a message; but no message is ever in memory, and the
functions that would convert one report failure.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

from .rosidl_structs import CSequence, CString, C_IDENTIFIER, FASTRTPS_IDENTIFIER, FastrtpsCallbacks, Field, FieldType, Getter, HandleFunction, INTROSPECTION_IDENTIFIER, IndividualTypeDescription, MessageMember, MessageMembers, MessageTypeSupport, TypeDescription, TypeHash, TypeSource, wrap_pointer
from .message_fields import HASH_PREFIX, Shape, defined_hash, fields_of, references_of, split_name

if TYPE_CHECKING:
    from ..messages.ros_types import Typestore
    from .message_fields import MessageField

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
                    field.description_id,
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
            element = nested.layout if nested else field.ctype
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
            field.introspection_id,
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
        made = RuntimeType(msgtype, typestore)
        if _TYPES.setdefault(key, made) is made:
            # Kept beyond the end of this module: the middleware outlives it.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(made))
    return _TYPES[key]
