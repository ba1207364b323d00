# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Values in a block of Cloudini's: where they begin, and the numbers that their bytes mean.

They are of fixed widths, varints of 7 bits a byte, the lowest first, or Gorilla's: see
read_gorilla. Which fields have which stands in cloudini.py, and so does the source.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Octets = npt.NDArray[np.uint8]
    Positions = npt.NDArray[np.intp]


# Records: values of fields in turn, each of a fixed width or as wide as its bytes say.

VARINT, GORILLA = 0, -1
"""Widths of values that are as wide as their bytes say."""
_SHORT_DIGITS = 4  # of 7 bits
_LAST = 0x7F  # the largest last byte of a varint
_LONGEST = 10  # bytes of either
_NEW_HEAD, _REPEATED_HEAD = 13, 2  # bits of Gorilla's before the value
_EMPTY = memoryview(b'')
_BITS = np.uint64(64)


class Records(NamedTuple):
    """Records in a block: where each value begins, (N,) for each width; and where the last ends."""

    starts: list[Positions]
    end: int


def read_records(block: Octets, at: int, widths: Sequence[int], count: int) -> Records:
    """Find the values of records.

    Args:
        block: The bytes.
        at: Where the first record begins.
        widths: Of the values of a record in turn: bytes, VARINT or GORILLA.
        count: Number of records.

    Raises:
        ValueError: The block ends before.
    """
    if not count or not widths:
        return Records([np.empty(0, np.intp) for _ in widths], at)
    if all(width > 0 for width in widths):
        step = sum(widths)
        if at + count * step > len(block):
            raise too_short(count)
        first = at + step * np.arange(count, dtype=np.intp)
        offsets = np.cumsum([0, *widths[:-1]])
        return Records([first + offset for offset in offsets], at + count * step)
    if not any(widths):
        last_bytes = at + np.flatnonzero(block[at:] <= _LAST)[: count * len(widths)]
        if len(last_bytes) < count * len(widths):
            raise too_short(count)
        starts = np.concatenate([[at], last_bytes[:-1] + 1]).reshape(count, len(widths))
        return Records([*starts.T], int(last_bytes[-1]) + 1)
    most = count * sum(width if width > 0 else _LONGEST for width in widths)
    records = _RecordWalk(block[at : at + most], widths).read(count)
    return Records([at + starts for starts in records.starts], at + records.end)


def too_short(count: int) -> ValueError:
    """Return the error of a block that ends too early."""
    return ValueError(f'a chunk ends before its {count} points do')


def read_short_differences(block: Octets, count: int) -> npt.NDArray[np.int32] | None:
    """Read a block of varints alone, and undo zigzag, all at once.

    Returns:
        (count,) differences; None where one is longer than 28 bits or missing, or the block has
        another number of them.
    """
    is_last = block <= _LAST
    is_first = np.ones(len(block), bool)
    is_first[1:] = is_last[:-1]
    octets = block[is_first]
    if len(octets) != count or not is_last[-1:].all():
        return None
    numbers = (octets & _LAST).astype(np.int32)
    longer, places = np.flatnonzero(octets > _LAST), np.flatnonzero(is_first & ~is_last)
    for digit in range(1, _SHORT_DIGITS):
        octets = block[places + digit]
        numbers[longer] |= (octets & _LAST).astype(np.int32) << 7 * digit
        goes_on = octets > _LAST
        longer, places = longer[goes_on], places[goes_on]
    if len(longer) or not numbers.all():
        return None
    numbers -= 1
    signs = numbers & 1
    numbers >>= 1
    numbers ^= -signs
    return numbers


class _RecordWalk:
    """Walks from record to record, where a width depends on the bytes.

    Where a part of a record ends is tabulated for each byte at which it could begin; a part has
    all values up to one of Gorilla's, whose width may depend on the ones before.

    Args:
        block: The bytes, from the first record on.
        widths: Of the values of a record.
    """

    def __init__(self, block: Octets, widths: Sequence[int]) -> None:
        self._block = block
        self._widths = widths
        self._beyond = len(block) + 1
        is_last = block <= _LAST
        # The number of varints that end before a byte, and where each ends.
        self._ended = np.full(self._beyond + _LONGEST, np.count_nonzero(is_last), np.int32)
        np.cumsum(is_last[:-1], out=self._ended[1 : len(block)])
        self._ended[0] = 0
        padding = np.full(len(widths), self._beyond)
        self._ends = np.concatenate([np.flatnonzero(is_last) + 1, padding])

    def read(self, count: int) -> Records:
        """Find the values of records from the first byte on.

        Raises:
            ValueError: The block ends before.
        """
        parts: list[list[int]] = [[]]
        for width in self._widths:
            if width == GORILLA:
                parts.append([])
            else:
                parts[-1].append(width)
        begins, end = self._walk([self._table(part) for part in parts], count)
        starts = []
        for number, (part, position) in enumerate(zip(parts, begins, strict=True)):
            for width in part:
                starts.append(position)
                position = self._after(position, [width])  # noqa: PLW2901 - of the next value
            if number + 1 < len(parts):
                starts.append(position)
        return Records(starts, end)

    def _after(self, position: Positions, widths: Sequence[int]) -> Positions:
        """Return where values of varints and fixed widths end that begin at positions."""
        varints = 0
        for width in (*widths, None):
            if width == VARINT:
                varints += 1
                continue
            if varints:
                position = self._ends[self._ended[position] + (varints - 1)]
                varints = 0
            if width is not None:
                position = np.minimum(position + width, self._beyond)
        return position

    def _table(self, widths: Sequence[int]) -> memoryview:
        ends = self._after(np.arange(len(self._ended), dtype=np.intp), widths)
        return np.minimum(ends, self._beyond).astype(np.int32).data

    def _walk(self, tables: Sequence[memoryview], count: int) -> tuple[list[Positions], int]:
        """Return where each part of the records begins, and where the last ends."""
        steps, repeats = self._gorilla_tables() if len(tables) > 1 else (_EMPTY, _EMPTY)
        begins: list[list[int]] = [[] for _ in tables]
        bytes_before = [0] * len(tables)
        at = 0
        for record in range(count):
            for number, table in enumerate(tables):
                begins[number].append(at)
                at = table[at]
                if number + 1 == len(tables):
                    break
                step = steps[at] if record else 8
                if step > 1 and record:
                    bytes_before[number] = repeats[at]
                at += step or bytes_before[number]
        if at == self._beyond:
            raise too_short(count)
        return [np.array(positions, np.intp) for positions in begins], at

    def _gorilla_tables(self) -> tuple[memoryview, memoryview]:
        """Tabulate the bytes of a value that begins at a byte, 0 for as many as the one before.

        And those of the next value of as many bits.
        """
        padded = np.zeros(len(self._ended) + 1, np.uint16)
        padded[: len(self._block)] = self._block
        words = padded[:-1] | padded[1:] << 8
        bits = (words >> 7 & 63) + 1
        steps = np.where(words & 1, np.where(words & 2, (_NEW_HEAD + bits + 7) >> 3, 0), 1)
        repeats = (_REPEATED_HEAD + bits + 7) >> 3
        return steps.astype(np.uint8).data, repeats.astype(np.uint8).data


# Numbers.


def read_fixed(block: Octets, starts: Positions, kind: str) -> npt.NDArray[Any]:
    """Read numbers at positions."""
    size = int(np.dtype(kind).itemsize)
    if not len(starts):
        return np.empty(0, kind)
    if starts[-1] + size > len(block):
        raise too_short(len(starts))
    windows = np.lib.stride_tricks.sliding_window_view(block, size)
    return np.ascontiguousarray(windows[starts]).view(kind).reshape(-1)


def read_varints(block: Octets, starts: Positions) -> npt.NDArray[np.uint64]:
    """Read varints at positions, which end within the block: 7 bits a byte, the lowest first."""
    octets = block[starts]
    values = (octets & 0x7F).astype(np.uint64)
    [longer] = np.nonzero(octets > 0x7F)
    for digit in range(1, _LONGEST + 1):
        if not len(longer):
            return values
        octets = block[starts[longer] + digit]
        values[longer] |= (octets & 0x7F).astype(np.uint64) << np.uint64(min(7 * digit, 63))
        longer = longer[octets > 0x7F]
    raise ValueError('an integer has more than 64 bits')


def read_gorilla(block: Octets, starts: Positions) -> npt.NDArray[np.uint64]:
    """Read FLOAT64 that are XORed with the one before, (N,) bits.

    The bits of a value are taken from the lowest of a byte on. The first has 64; of others
    bit 0 is 0 for no change, bit 1 is 0 for as many changed bits at the same position as before.
    Else 5 bits are the number of zeros above the changed ones, and 6 their number less one.
    """
    padded = np.concatenate([block, np.zeros(_LONGEST, np.uint8)])
    words = read_fixed(padded, starts, '<u8')
    rest = read_fixed(padded, starts + 8, '<u2').astype(np.uint64)
    is_new = words & np.uint64(3) == 3
    is_new[0] = False
    last_new = np.maximum.accumulate(np.where(is_new, np.arange(len(starts)), -1))
    has_repeated = (words[1:] & np.uint64(3) == 1) & (last_new[1:] < 0)
    count = (words[last_new] >> np.uint64(7) & np.uint64(63)) + np.uint64(1)
    above = words[last_new] >> np.uint64(2) & np.uint64(31)
    if has_repeated.any() or (count + above > _BITS)[last_new >= 0].any():
        raise ValueError('a FLOAT64 has more than 64 bits, or those of none before')
    head = np.where(is_new, _NEW_HEAD, _REPEATED_HEAD).astype(np.uint64)
    bits: npt.NDArray[np.uint64] = words >> head | rest << _BITS - head
    bits &= np.uint64(2**64 - 1) >> _BITS - count
    bits <<= _BITS - count - above
    bits[words & np.uint64(1) == 0] = 0
    bits[0] = words[0]
    return bits


def undo_zigzag(values: npt.NDArray[np.uint64]) -> npt.NDArray[np.int64]:
    """Undo zigzag, to which 1 was added so that a byte of 0 is none.

    Raises:
        ValueError: A value is 0.
    """
    if not values.all():
        raise ValueError('an integer is 0, which is for missing floats alone')
    values = values - np.uint64(1)
    return np.asarray((values >> np.uint64(1)) ^ -(values & np.uint64(1))).view(np.int64)
