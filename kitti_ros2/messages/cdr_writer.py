# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes CDR field by field, for message types that are large and made many times.

rosbags generates code for a type when it is first used, 35 ms for the three arrays of labels, and
wants an object for every point and pose; what is written here needs neither. Tests hold the bytes
against rosbags' own. Format: CDR little endian as DDS has it (OMG formal/2008-01-09, 15.3):
every number is aligned to its size, counted from behind the four bytes of encapsulation.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_ENCAPSULATION = b'\x00\x01\x00\x00'
_PADDING = tuple(bytes(count) for count in range(8))
_UINT32 = struct.Struct('<I')
_STAMP = struct.Struct('<iI')
_INT32 = tuple(struct.Struct(f'<{count}i') for count in range(9))
_DOUBLES = tuple(struct.Struct(f'<{count}d') for count in range(64))


class CdrWriter:
    """A message under construction; the fields are to be written in the order of the type."""

    __slots__ = ('_data',)

    def __init__(self) -> None:
        self._data = bytearray(_ENCAPSULATION)

    def finish(self) -> bytes:
        """The message so far, encapsulation included, filled up as cdr.serialize does."""
        return bytes(self._data) + _PADDING[-len(self._data) % 4]

    def block(self, data: bytes) -> None:
        """Fields of at most four bytes that were written before: what block_bytes gave."""
        self._align(4)
        self._data += data

    def block_bytes(self) -> bytes:
        """The fields so far without the encapsulation, to be put into other messages."""
        return bytes(self._data[len(_ENCAPSULATION) :])

    def _align(self, size: int) -> None:
        # The encapsulation's four bytes do not count.
        self._data += _PADDING[(4 - len(self._data)) % size]

    def uint32(self, value: int) -> None:
        """A uint32, or the length of a sequence."""
        self._align(4)
        self._data += _UINT32.pack(value)

    def int32(self, *values: int) -> None:
        """One to eight int32."""
        self._align(4)
        self._data += _INT32[len(values)].pack(*values)

    def float64(self, values: Iterable[float]) -> None:
        """One or more float64, at most 63."""
        packed = tuple(values)
        self._align(8)
        self._data += _DOUBLES[len(packed)].pack(*packed)

    def boolean(self, *, value: bool) -> None:
        """A bool."""
        self._data.append(value)

    def byte(self, value: int) -> None:
        """A byte, as DiagnosticStatus has it."""
        self._data.append(value)

    def text(self, value: str) -> None:
        """A string."""
        encoded = value.encode()
        self.uint32(len(encoded) + 1)
        self._data += encoded
        self._data.append(0)

    def raw_float64(self, data: bytes) -> None:
        """Numbers that are float64 already, in memory order."""
        if data:
            self._align(8)
            self._data += data

    def header(self, stamp_ns: int, frame_id: str) -> None:
        """A std_msgs/Header."""
        self._align(4)
        self._data += _STAMP.pack(*divmod(stamp_ns, 1_000_000_000))
        self.text(frame_id)
