# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Publishes serialised messages without holding the interpreter's lock.

rclpy keeps the lock while the middleware copies a message, half a millisecond for a scan, so that
the next message cannot be read in that time. The same function of rcl, called through ctypes,
releases it: rcl_publish_serialized_message of rcl/publisher.h, with rcl_serialized_message_t,
which is rcutils_uint8_array_t of rcutils/types/uint8_array.h.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher

_OK = 0


class _SerializedMessage(ctypes.Structure):
    """rcutils_uint8_array_t; the allocator is not used for reading."""

    _fields_: ClassVar = [
        ('buffer', ctypes.c_char_p),
        ('buffer_length', ctypes.c_size_t),
        ('buffer_capacity', ctypes.c_size_t),
        ('allocator', ctypes.c_void_p * 5),
    ]


@lru_cache(maxsize=1)
def _rcl_publish() -> Any:  # noqa: ANN401 - a C function, or None if it is not found
    try:
        function = ctypes.CDLL('librcl.so').rcl_publish_serialized_message
    except (OSError, AttributeError):
        return None
    function.argtypes = [
        ctypes.c_void_p,
        ctypes.POINTER(_SerializedMessage),
        ctypes.c_void_p,
    ]
    function.restype = ctypes.c_int32
    return function


def byte_publisher(publisher: Publisher) -> Callable[[bytes], None]:
    """Return a function that publishes serialised messages like publisher.publish; one thread."""
    function, handle = _rcl_publish(), publisher.handle
    if function is None or not hasattr(handle, 'pointer'):
        plain: Callable[[bytes], None] = publisher.publish
        return plain
    pointer = handle.pointer
    message = _SerializedMessage()
    reference = ctypes.byref(message)

    def publish(data: bytes) -> None:
        message.buffer = data
        message.buffer_length = message.buffer_capacity = len(data)
        with handle:  # keeps it from being destroyed
            result = function(pointer, reference, None)
        message.buffer = None
        if result != _OK:
            publisher.publish(data)  # raises the proper error

    return publish
