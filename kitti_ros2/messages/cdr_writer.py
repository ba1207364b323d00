# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Serialisation of CDR field by field, for large and frequent messages.

rosbags generates code for a type when it is first used, 35 ms for the three arrays of labels, and
needs an object for every point and pose; this writer avoids both. Tests compare the bytes with
those of rosbags. Format: CDR little endian as in DDS (OMG formal/2008-01-09, 15.3): every number is
aligned to its size, counted from the end of the four bytes of encapsulation.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_ENCAPSULATION = b'\x00\x01\x00\x00'
_PADDING = tuple(bytes(count) for count in range(8))
_UINT32 = struct.Struct('<I')
_FLOAT32 = struct.Struct('<f')
_STAMP = struct.Struct('<iI')
_INT32 = tuple(struct.Struct(f'<{count}i') for count in range(9))
_DOUBLES = tuple(struct.Struct(f'<{count}d') for count in range(64))


class CdrWriter:
    """A message under construction; fields must be written in the order of the type."""

    __slots__ = ('_data',)

    def __init__(self) -> None:
        self._data = bytearray(_ENCAPSULATION)

    def finish(self) -> bytes:
        """Return the message so far, encapsulation included, padded as cdr.serialize does."""
        return bytes(self._data) + _PADDING[-len(self._data) % 4]

    def block(self, data: bytes) -> None:
        """Write the result of block_bytes: serialised fields with an alignment of at most four."""
        self._align(4)
        self._data += data

    def block_bytes(self) -> bytes:
        """Return the fields so far without encapsulation, for use in other messages."""
        return bytes(self._data[len(_ENCAPSULATION) :])

    def _align(self, size: int) -> None:
        # Without the four bytes of encapsulation.
        self._data += _PADDING[(4 - len(self._data)) % size]

    def uint32(self, value: int) -> None:
        """Write a uint32, or the length of a sequence."""
        self._align(4)
        self._data += _UINT32.pack(value)

    def int32(self, *values: int) -> None:
        """Write one to eight int32."""
        self._align(4)
        self._data += _INT32[len(values)].pack(*values)

    def float64(self, values: Iterable[float]) -> None:
        """Write up to 63 float64."""
        packed = tuple(values)
        self._align(8)
        self._data += _DOUBLES[len(packed)].pack(*packed)

    def float32(self, value: float) -> None:
        """Write a float32."""
        self._align(4)
        self._data += _FLOAT32.pack(value)

    def boolean(self, *, value: bool) -> None:
        """Write a bool."""
        self._data.append(value)

    def byte(self, value: int) -> None:
        """Write a uint8, or a byte, the type in DiagnosticStatus."""
        self._data.append(value)

    def octets(self, data: bytes) -> None:
        """Write an array of uint8."""
        self._data += data

    def text(self, value: str) -> None:
        """Write a string."""
        encoded = value.encode()
        self.uint32(len(encoded) + 1)
        self._data += encoded
        self._data.append(0)

    def raw_float64(self, data: bytes) -> None:
        """Write bytes of float64, in memory order."""
        if data:
            self._align(8)
            self._data += data

    def time(self, stamp_ns: int) -> None:
        """Write a builtin_interfaces/Time."""
        self._align(4)
        self._data += _STAMP.pack(*divmod(stamp_ns, 1_000_000_000))

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """Write a std_msgs/Header."""
        self.time(stamp_ns)
        self.text(frame_id)
