# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Mutations of inputs: of any bytes, and of lines, words and numbers of texts."""

from __future__ import annotations

import re
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from random import Random

_INTEGERS = (
    *(0, 1, 2, 3, 4, 7, 8, 15, 16, 31, 32, 63, 64, 100, 127, 128, 255, 256, 1000, 4096),
    *(2**15 - 1, 2**15, 2**16 - 1, 2**16, 10**6, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**32),
    *(10**9, 10**18, 2**53, 2**63 - 1, 2**63, 2**64 - 1),
)
_NUMBERS = (
    *(b'nan', b'-nan', b'inf', b'-inf', b'Infinity', b'1e308', b'-1e308', b'1e309', b'1e-320'),
    *(b'0', b'-0', b'-0.0', b'-1', b'1', b'0.5', b'1e9', b'1e18', b'1e19', b'-1e30', b'1e100'),
    *(b'9' * 30, b'9' * 400, b'9' * 5000, b'0x10', b'0o17', b'010', b'1_000', b'1.', b'.5', b'+1'),
    *(b'--1', b'1e', b'1,5', b'\xd9\xa3', b'\xef\xbc\x91', b'\xc2\xb2', b'999999', b'1000000'),
    *(b'2147483647', b'2147483648', b'-2147483649', b'9223372036854775807'),
    *(b'9223372036854775808', b'18446744073709551616', b'4294967295', b'360', b'1e-9'),
)
_BLANKS = (
    *(b' ', b'\t', b'\n', b'\r', b'\r\n', b'\n\n', b'\x0b', b'\x0c', b'\x1c', b'\x1d', b'\x85'),
    *(b'\x00', b'\xc2\xa0', b'\xc2\x85', b'\xe2\x80\xa8', b'\xe2\x80\xa9', b'\xe3\x80\x80'),
    *(b'\xef\xbb\xbf', b'\xff\xfe', b'\xe2\x80\xae', b'\xed\xa0\x80', b'\xff', b'\x1b[31m', b','),
)
_NUMBER = re.compile(rb'[-+]?\d[\d.eE+-]*')
_WORD = re.compile(rb'[^\s:,{}\[\]<>"\x27]+')
_STRUCTS = tuple(struct.Struct(order + kind) for order in '<>' for kind in 'BHIQ')
_LONGEST = 1 << 16


class Mutator:
    """Makes inputs from others.

    Args:
        random: The source of chance; its seed gives the same inputs again.
        words: Texts to insert.
        is_text: Whether inputs are texts.
    """

    def __init__(self, random: Random, words: Sequence[bytes] = (), *, is_text: bool) -> None:
        self._random = random
        self._words = words
        self._kinds: list[Callable[[bytes], bytes]] = [
            self._flip, self._overwrite, self._remove, self._repeat, self._insert, self._copy,
        ]  # fmt: skip
        if is_text:
            self._kinds += [self._number, self._number, self._word, self._word, self._blank]
            self._kinds += [self._line, self._line]
        elif words:
            self._kinds += [self._paste]
        if is_text and words:
            self._kinds += [self._word_of_list]

    def mutate(self, data: bytes, other: bytes) -> bytes:
        """Return another input, sometimes with a part of a second one."""
        random = self._random
        if random.random() < 0.05 and other:
            data = self._splice(data, other)
        longest = max(_LONGEST, len(other))
        for _ in range(random.choice((1, 1, 1, 2, 2, 3, 5, 8))):
            data = random.choice(self._kinds)(data)[:longest]
        return data

    def _at(self, data: bytes) -> int:
        return self._random.randrange(len(data) + 1)

    def _span(self, data: bytes) -> tuple[int, int]:
        start = self._at(data)
        most = self._random.choice((1, 2, 4, 8, 16, 64, 256, 4096, 1 << 16))
        return start, min(start + self._random.randint(1, most), len(data))

    def _flip(self, data: bytes) -> bytes:
        if not data:
            return b'\0'
        at = self._random.randrange(len(data))
        changed = data[at] ^ (1 << self._random.randrange(8))
        return data[:at] + bytes((changed,)) + data[at + 1 :]

    def _overwrite(self, data: bytes) -> bytes:
        form = self._random.choice(_STRUCTS)
        value = self._random.choice(_INTEGERS) + self._random.choice((-1, 0, 0, 0, 1))
        if self._random.random() < 0.2:
            value = len(data) - self._random.randrange(64)
        at = self._random.randrange(max(len(data) - form.size, 0) + 1)
        packed = form.pack(value % (1 << 8 * form.size))
        return data[:at] + packed + data[at + form.size :]

    def _remove(self, data: bytes) -> bytes:
        start, end = self._span(data)
        if self._random.random() < 0.1:
            return data[:start]
        return data[:start] + data[end:]

    def _repeat(self, data: bytes) -> bytes:
        start, end = self._span(data)
        times = self._random.choice((*[1] * 12, 2, 2, 2, 10, 10, 100))
        return data[:end] + data[start:end] * min(times, _LONGEST // (end - start + 1)) + data[end:]

    def _insert(self, data: bytes) -> bytes:
        at = self._at(data)
        size = self._random.choice((1, 2, 4, 8, 32))
        return data[:at] + self._random.randbytes(size) + data[at:]

    def _copy(self, data: bytes) -> bytes:
        start, end = self._span(data)
        at = self._at(data)
        return data[:at] + data[start:end] + data[at + end - start :]

    def _paste(self, data: bytes) -> bytes:
        word = self._random.choice(self._words)
        at = self._at(data)
        behind = at + len(word) * self._random.randrange(2)
        return data[:at] + word + data[behind:]

    def _replace(self, pattern: re.Pattern[bytes], data: bytes, new: bytes) -> bytes:
        start = self._at(data)
        found = pattern.search(data, start) or pattern.search(data)
        if found is None:
            return self._insert(data)
        return data[: found.start()] + new + data[found.end() :]

    def _number(self, data: bytes) -> bytes:
        return self._replace(_NUMBER, data, self._random.choice(_NUMBERS))

    def _word(self, data: bytes) -> bytes:
        words = _WORD.findall(data[:2000])
        new = self._random.choice(words) if words and self._random.random() < 0.7 else b''
        return self._replace(_WORD, data, new)

    def _word_of_list(self, data: bytes) -> bytes:
        word = self._random.choice(self._words)
        if self._random.random() < 0.5:
            return self._replace(_WORD, data, word)
        at = self._at(data)
        return data[:at] + word + data[at:]

    def _blank(self, data: bytes) -> bytes:
        at = self._at(data)
        return data[:at] + self._random.choice(_BLANKS) + data[at:]

    def _line(self, data: bytes) -> bytes:
        lines = data.splitlines(keepends=True)
        if not lines:
            return b'\n'
        first, second = (self._random.randrange(len(lines)) for _ in range(2))
        kind = self._random.randrange(4)
        if kind == 0:
            del lines[first]
        elif kind == 1:
            lines[first], lines[second] = lines[second], lines[first]
        elif kind == 2:
            lines.insert(first, lines[second])
        else:
            times = self._random.choice((*[2] * 10, *[10] * 5, 300))
            lines[first] *= min(times, _LONGEST // len(lines[first]) + 1)
        return b''.join(lines)

    def _splice(self, data: bytes, other: bytes) -> bytes:
        return data[: self._at(data)] + other[self._at(other) :]
