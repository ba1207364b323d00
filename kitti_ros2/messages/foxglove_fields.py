# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The fields of a message with one of Foxglove's schemas, in protobuf, JSON or ROS encoding.

A missing field has its default value, as in protobuf: older versions of a schema have fewer
fields.
"""

from __future__ import annotations

import binascii
from base64 import b64decode
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.geometry import Transform
from ..model.streams import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Float64Array

_SECONDS = ('sec', 'seconds')
_NANOSECONDS = ('nsec', 'nanos', 'nanosec')
_LARGEST = 2**32 - 1


class Fields:
    """The fields of a protobuf or ROS message, by the names of Foxglove's schemas.

    ROS spells all names in lower case. Subclasses read other encodings.

    Args:
        message: The decoded message; None is one without fields.
    """

    def __init__(self, message: Any) -> None:  # noqa: ANN401 - of any encoding
        self._message = message

    def value(self, name: str) -> Any:  # noqa: ANN401 - of any type
        """Return the value of a field, None if it is missing."""
        field = getattr(self._message, name, None)
        if field is None:
            return getattr(self._message, name.lower(), None)
        if hasattr(field, 'DESCRIPTOR') and not self._message.HasField(name):
            return None
        return field

    def text(self, name: str) -> str:
        """Return a string.

        Raises:
            ValueError: The value is of another type; so do all others.
        """
        text = self.value(name)
        if text is None:
            return ''
        if not isinstance(text, str):
            raise _wrong(name, 'a string', text)
        return text

    def number(self, name: str, default: float = 0.0) -> float:
        """Return a number."""
        number = self.value(name)
        if number is None:
            return default
        if isinstance(number, bool) or not isinstance(number, (int, float, np.number)):
            raise _wrong(name, 'a number', number)
        try:
            return float(number)
        except OverflowError as error:
            raise _wrong(name, 'a number', number) from error

    def integer(self, name: str, largest: int = _LARGEST) -> int:
        """Return an integer of 0 or more."""
        number = self.number(name)
        if not 0 <= number <= largest or number != int(number):
            raise _wrong(name, f'an integer from 0 to {largest}', number)
        return int(number)

    def numbers(self, name: str, *counts: int) -> Float64Array:
        """Return (N,) numbers; if counts are given, N is one of them."""
        sequence = self.value(name)
        try:
            numbers = np.array([] if sequence is None else sequence, np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise _wrong(name, 'a list of numbers', sequence) from error
        if numbers.ndim != 1 or (counts and len(numbers) not in counts):
            expected = ' or '.join(map(str, counts)) or 'a list of'
            raise _wrong(name, f'{expected} numbers', sequence)
        return numbers

    def data(self, name: str) -> bytes | memoryview:
        """Return bytes."""
        data = self.value(name)
        if isinstance(data, np.ndarray) and data.dtype == np.uint8:
            return memoryview(data.tobytes())
        if data is None:
            return b''
        if not isinstance(data, bytes):
            raise _wrong(name, 'bytes', data)
        return data

    def child(self, name: str) -> Fields:
        """Return the fields of a nested message; of a missing one all are missing."""
        return type(self)(self.value(name))

    def children(self, name: str) -> list[Fields]:
        """Return the fields of each message of a list."""
        messages = self.value(name)
        try:
            return [type(self)(message) for message in messages or ()]
        except TypeError as error:
            raise _wrong(name, 'a list', messages) from error

    def stamp_ns(self, name: str, default_ns: int) -> int:
        """Return a time, nanoseconds, or the default if the field is missing."""
        if self.value(name) is None:
            return default_ns
        time = self.child(name)
        seconds, nanoseconds = (
            next((key for key in keys if time.value(key) is not None), keys[0])
            for keys in (_SECONDS, _NANOSECONDS)
        )
        whole = time.integer(seconds, 2**31 - 1)
        return whole * NS_PER_S + time.integer(nanoseconds, NS_PER_S - 1)

    def xyz(self, name: str) -> tuple[float, float, float]:
        """Return a Vector3 or Point3."""
        point = self.child(name)
        return point.number('x'), point.number('y'), point.number('z')

    def xyzw(self, name: str) -> tuple[float, float, float, float]:
        """Return a Quaternion; a missing one, or one of zeros, is the identity."""
        fields = self.child(name)
        quaternion = (*self.xyz(name), fields.number('w'))
        return quaternion if any(quaternion) else (0.0, 0.0, 0.0, 1.0)

    def pose(self, name: str) -> Transform:
        """Return a Pose; a missing one is the identity.

        Raises:
            ValueError: Its numbers are no pose.
        """
        fields = self.child(name)
        xyzw = np.array(fields.xyzw('orientation'))
        position = np.array(fields.xyz('position'))
        length = np.linalg.norm(xyzw)
        if not (np.isfinite(position).all() and np.isfinite(length) and length > 0):
            raise ValueError(f'{name} is no pose: {position.tolist()}, {xyzw.tolist()}')
        return Transform.from_quaternion(xyzw / length, position)


class JsonFields(Fields):
    """The fields of a JSON object; bytes are base64.

    Args:
        message: The object as a dict; None is one without fields.

    Raises:
        ValueError: It is no object.
    """

    def __init__(self, message: Mapping[str, Any] | None) -> None:
        if message is not None and not isinstance(message, dict):
            raise ValueError(f'{_shown(message)} is no JSON object')
        super().__init__(message or {})

    def value(self, name: str) -> Any:  # noqa: ANN401 - of any type
        """Return the value of a field, None if it is missing."""
        return self._message.get(name)

    def data(self, name: str) -> bytes:
        """Return bytes."""
        try:
            return b64decode(self.text(name), validate=True)
        except (binascii.Error, ValueError) as error:
            raise ValueError(f'{name} is no base64 ({error})') from error

    def children(self, name: str) -> list[Fields]:
        """Return the fields of each object of a list."""
        messages = self.value(name)
        if messages is not None and not isinstance(messages, list):
            raise _wrong(name, 'a list', messages)
        return [JsonFields(message) for message in messages or ()]


def _wrong(name: str, expected: str, actual: object) -> ValueError:
    return ValueError(f'{name} is {_shown(actual)}; expected {expected}')


def _shown(value: object) -> str:
    """Return a value as a short text."""
    if isinstance(value, (str, int, float)):
        text = repr(value)
        return text if len(text) <= 40 else f'{text[:36]} ...'
    return f'a {type(value).__name__}'
