# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The C structures that describe a message type to the middleware, with the layout of ROS 2 Jazzy.

Each names the header that it mirrors, member by member, without the trailing underscores of some
member names. A test reads the types of an installed package through them, to detect a changed
layout.
"""

from __future__ import annotations

import ctypes
from typing import ClassVar

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
    """Of rosidl_runtime_c/type_description/individual_type_description__struct.h."""

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
    """Of rosidl_typesupport_introspection_c/message_introspection.h."""

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
    """Of rosidl_typesupport_introspection_c/message_introspection.h."""

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
