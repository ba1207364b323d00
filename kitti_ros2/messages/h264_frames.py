# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Missing packets of H.264, by the frame numbers in its slices.

FFmpeg conceals them: images up to the next key frame look sound and have wrong parts.
"""

from __future__ import annotations

import re

# ITU-T H.264 (08/2021): 7.3.1 units, 7.3.2.1.1 sequence parameter set, 7.3.3 slice header, 7.4.3
# frame_num. That of a picture is the one of the last reference picture before, or one more.

_START = re.compile(rb'\x00\x00\x01')
_READ_BYTES = 128
_WITH_CHROMA = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})
"""Profiles whose parameter set has the format of chroma."""
_SLICE, _IDR, _PARAMETERS = 1, 5, 7
_MOST_CYCLES = 255
_LONGEST_CODE = 32


class _Bits:
    """The bits of a unit, without its first byte and the bytes that prevent start codes."""

    def __init__(self, unit: bytes) -> None:
        data = unit[1:].replace(b'\0\0\3', b'\0\0')
        self._value, self._left = int.from_bytes(data, 'big'), 8 * len(data)

    def number(self, count: int) -> int:
        """Read an unsigned number of some bits.

        Raises:
            ValueError: The unit ends before.
        """
        self._left -= count
        if self._left < 0:
            raise ValueError('the unit is cut')
        return self._value >> self._left & ((1 << count) - 1)

    def code(self) -> int:
        """Read an Exp-Golomb code: ue(v), or se(v) where its value does not matter.

        Raises:
            ValueError: As number.
        """
        zeros = 0
        while not self.number(1):
            zeros += 1
            if zeros > _LONGEST_CODE:
                raise ValueError('no code is so long')
        return (1 << zeros) - 1 + self.number(zeros)


class FrameNumbers:
    """Follows the frame numbers of one video."""

    def __init__(self) -> None:
        self._bits = 0
        self._is_separate = False
        self._last: int | None = None

    def follows(self, data: bytes) -> bool:
        """Return whether no reference picture is missing before a packet, as far as it says."""
        try:
            for start in _START.finditer(data):
                unit = data[start.end() : start.end() + _READ_BYTES]
                kind = unit[0] & 31 if unit else 0
                if kind == _PARAMETERS:
                    self._read_parameters(_Bits(unit))
                elif kind in {_SLICE, _IDR}:
                    return self._read_slice(unit)
        except ValueError:  # the decoder detects it
            self._last = None
        return True

    def _read_parameters(self, bits: _Bits) -> None:
        """Read the length of frame numbers; 0 where gaps are allowed."""
        profile = bits.number(8)
        bits.number(16)
        bits.code()
        self._bits, self._is_separate = 0, False
        if profile in _WITH_CHROMA:
            if bits.code() == 3:
                self._is_separate = bool(bits.number(1))
            bits.code(), bits.code(), bits.number(1)
            if bits.number(1):  # scaling matrices, which encoders of cameras do not have
                return
        length = bits.code() + 4
        order = bits.code()
        if order == 0:
            bits.code()
        elif order == 1:
            bits.number(1), bits.code(), bits.code()
            for _ in range(min(bits.code(), _MOST_CYCLES)):
                bits.code()
        bits.code()
        self._bits = 0 if bits.number(1) else min(length, 16)

    def _read_slice(self, unit: bytes) -> bool:
        if not self._bits:
            return True
        bits = _Bits(unit)
        bits.code(), bits.code(), bits.code()
        if self._is_separate:
            bits.number(2)
        number, last = bits.number(self._bits), self._last
        if unit[0] >> 5 & 3:  # a reference picture
            self._last = number
        if last is None or unit[0] & 31 == _IDR:
            return True
        return number in {last, (last + 1) % (1 << self._bits)}
