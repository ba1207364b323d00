# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The Python class of a message type for rclpy: the installed one, or one built at run time."""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

from ..model.errors import MissingDataError
from .rosidl_structs import Getter, MessageTypeSupport, TypeHash, unwrap_pointer
from .message_fields import check_size, defined_hash, split_name
from .runtime_types import runtime_type

if TYPE_CHECKING:
    from ..messages.ros_types import Typestore

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
        made = _installed_class(*key) or _runtime_class(msgtype, typestore)
        return _CLASSES.setdefault(key, made)
    return _CLASSES[key]


def type_hash(cls: type) -> str:
    """Return the type hash of a message class, RIHS01_ and 64 hexadecimal digits.

    Raises:
        MissingDataError: The class is not a ROS 2 message, or its package's libraries are missing.
    """
    metaclass: Any = type(cls)
    try:
        if metaclass._TYPE_SUPPORT is None:  # noqa: SLF001 - the contract that rclpy itself uses
            metaclass.__import_type_support__()
        address = unwrap_pointer(metaclass._TYPE_SUPPORT)  # noqa: SLF001 - as above
    except Exception as error:  # a broken installation may raise anything
        raise MissingDataError(
            f'{cls.__module__}.{cls.__name__}: the installed package does not work with ROS 2'
            f' ({error}); install it again, or remove it from PYTHONPATH'
        ) from error
    support = MessageTypeSupport.from_address(address)
    found = TypeHash.from_address(Getter(support.get_type_hash_func)(address))
    return f'RIHS{found.version:02}_{bytes(found.value).hex()}'


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
            f' use Jazzy, or remove it from PYTHONPATH'
        )
    cls: type | None = getattr(module, name, None)
    if cls is not None and (found := type_hash(cls)) != expected:
        raise MissingDataError(
            f'{msgtype}: the installed package {package} defines it differently ({found}) than'
            f' ROS 2 Jazzy ({expected}); install the package of Jazzy, or remove it from PYTHONPATH'
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
