# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of ROS 2 messages to ROS 1: definitions, md5 sums and bytes.

All differences are handled here:

- std_msgs/Header has a seq in ROS 1 (written as 0), which rosbags' byte conversion handles.
- CameraInfo's d k r p are named D K R P; the bytes are the same.
- Fields of Marker that are missing in ROS 1 (texture, uv_coordinates, mesh_file) are left out.
- Types missing in Noetic's store (tf2_msgs, vision_msgs) keep ROS 2's fields with ROS 1's Header.
  For TFMessage this equals ROS 1's definition; Detection3DArray, which ROS 1 defined differently
  (class numbers instead of names), stays readable by the definition in the bag.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosbags.typesys import Stores, get_typestore

from ..messages.type_definitions import closure, nested_type
from ..model.msgtypes import HEADER

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosbags.typesys.store import Typestore


class Ros1Types:
    """The ROS 1 counterparts of the types in a ROS 2 typestore."""

    def __init__(self, typestore: Typestore) -> None:
        self._ros2 = typestore
        self._ros1 = get_typestore(Stores.ROS1_NOETIC)

    def definition(self, msgtype: str) -> tuple[str, str]:
        """Return the text and the md5 sum of a type in ROS 1."""
        self._complete(msgtype)
        return self._ros1.generate_msgdef(msgtype, ros_version=1)

    def converter(self, msgtype: str) -> Callable[[bytes | memoryview], memoryview]:
        """Return a function that converts the type's CDR to ROS 1's serialization."""
        self._complete(msgtype)
        if self._same_layout(msgtype):
            return lambda data: self._ros2.cdr_to_ros1(data, msgtype)
        return lambda data: self._ros1.serialize_ros1(
            self._rebuild(self._ros2.deserialize_cdr(data, msgtype), msgtype), msgtype
        )

    def _complete(self, msgtype: str) -> None:
        known = self._ros1.fielddefs
        types = {**self._ros2.fielddefs, **known}
        missing = {name: types[name] for name in closure(types, msgtype) if name not in known}
        if missing:
            self._ros1.register(missing)

    def _same_layout(self, msgtype: str) -> bool:
        if msgtype == HEADER:
            return True
        fields1, fields2 = (store.fielddefs[msgtype][1] for store in (self._ros1, self._ros2))
        if len(fields1) != len(fields2):
            return False
        for (name1, kind1), (name2, kind2) in zip(fields1, fields2, strict=True):
            if name1.lower() != name2.lower() or kind1 != kind2:
                return False
            nested = nested_type(kind1)
            if nested is not None and not self._same_layout(nested):
                return False
        return True

    def _rebuild(self, message: object, msgtype: str) -> object:
        values = {
            name: self._value(message, name, nested_type(description))
            for name, description in self._ros1.fielddefs[msgtype][1]
        }
        build: Callable[..., object] = self._ros1.types[msgtype]
        return build(**values)

    def _value(self, message: object, name: str, nested: str | None) -> object:
        # Only Header has a field that ROS 2 dropped, and only CameraInfo has capitals.
        value = getattr(message, name.lower(), 0)
        if nested is None:
            return value
        if isinstance(value, list):
            return [self._rebuild(item, nested) for item in value]
        return self._rebuild(value, nested)
