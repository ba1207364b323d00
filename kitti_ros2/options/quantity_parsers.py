# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of quantities: sizes, times, lengths in metres, shares; see parsers.py."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from ..model.errors import UsageError
from ..model.stamps import parse_seconds, parse_stamp
from ..model.text import shown
from .parsers import parse_text

if TYPE_CHECKING:
    from fractions import Fraction

_SIZE = re.compile(r'(\d{1,100}(?:\.\d{1,100})?)\s*([kMGT]?)(i?)B?', re.ASCII)
_LEAST_SPLIT_BYTES = 1_000_000
# An exponent of many digits would take all memory as a fraction.
_SHARE = re.compile(r'\d{0,50}\.?\d{0,50}(?:[eE][-+]?\d{1,2})?|\d{1,50}/\d{1,50}', re.ASCII)
_IMAGE_SIZE = re.compile(r'(\d{1,5})[xX,](\d{1,5})', re.ASCII)
_POWERS = {'': 0, 'k': 1, 'M': 2, 'G': 3, 'T': 4}


def parse_bytes(text: str) -> int:
    """Parse a size such as 2GB, 500 MB or 1GiB to bytes.

    Raises:
        ValueError: The text is not a size.
    """
    match = _SIZE.fullmatch(text.strip())
    if match is None:
        raise ValueError(text)
    return int(float(match[1]) * (1024 if match[3] else 1000) ** _POWERS[match[2]])


def parse_size(name: str, value: object) -> int:
    """Parse a size such as 2GB."""
    try:
        return parse_bytes(parse_text(name, value))
    except ValueError:
        raise UsageError(f'{name} takes a size such as 2GB, not {shown(value)}') from None


def parse_split_size(name: str, value: object) -> int:
    """Parse the size of one file of a bag, such as 2GB; below 1MB the unit is likely missing."""
    size = parse_size(name, value)
    if size < _LEAST_SPLIT_BYTES:
        raise UsageError(
            f'{name} {value} is less than 1MB; give a size with its unit, such as 500MB or 2GB'
        )
    return size


def parse_seconds_ns(name: str, value: object) -> int:
    """Parse seconds such as 60s to nanoseconds."""
    try:
        return parse_seconds(str(value).removesuffix('s'))
    except ValueError:
        raise UsageError(f'{name} takes seconds such as 60s, not {shown(value)}') from None


def parse_epoch(name: str, value: object) -> int:
    """Parse a UTC time to nanoseconds since 1970."""
    try:
        return parse_stamp(str(value).removesuffix('+00:00'))
    except ValueError:
        raise UsageError(
            f"{name} takes a UTC time such as '2011-09-26 00:00:00', not {shown(value)}"
        ) from None


def parse_place(name: str, value: object) -> tuple[float, ...]:
    """Parse numbers in metres, such as x, y and z."""
    items = value if isinstance(value, (list, tuple)) else str(value).replace(',', ' ').split()
    try:
        return tuple(float(item) for item in items)
    except (TypeError, ValueError, OverflowError):
        raise UsageError(
            f'{name} takes three numbers x,y,z in metres, not {shown(value)}'
        ) from None


def parse_four_numbers(name: str, value: object) -> tuple[float, ...]:
    """Parse four numbers in metres: from and to forward, from and to to the left."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(',')
        back, front, right, left = (float(word) for word in words)
    except (ValueError, TypeError, OverflowError):
        raise UsageError(
            f'{name} takes four numbers in metres, from and to forward, from and to to the left,'
            f" such as '-10,60,-25,25', not {shown(value)}"
        ) from None
    return back, front, right, left


def parse_boxes(name: str, value: object) -> tuple[tuple[float, ...], ...]:
    """Parse boxes, six numbers in metres each: xmin ymin zmin xmax ymax zmax, and the next box."""
    try:
        numbers = [float(str(word)) for word in _flat(value)]
    except ValueError:
        numbers = []
    if len(numbers) % 6 or (value and not numbers):
        given = ' '.join(map(str, _flat(value)))
        raise UsageError(
            f'{name} takes six numbers in metres for each box, xmin ymin zmin xmax ymax zmax,'
            f' such as 0 -40 -3 70.4 40 1, not {shown(given)}'
        )
    return tuple(tuple(numbers[place : place + 6]) for place in range(0, len(numbers), 6))


def _flat(value: object) -> list[object]:
    """Return the items of nested lists; texts are split at blanks and commas."""
    if isinstance(value, str):
        return [*value.replace(',', ' ').split()]
    if isinstance(value, (list, tuple)):
        return [item for each in value for item in _flat(each)]
    return [value]


def parse_span(name: str, value: object) -> tuple[float, float]:
    """Parse the lowest and the highest value, MIN:MAX; an end that is left out is infinite."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(':')
        low, high = (None if word in (None, '') else float(word) for word in words)
    except (ValueError, TypeError, OverflowError):
        low, high = None, None
    if low is None and high is None:
        raise UsageError(
            f'{name} takes MIN:MAX in metres, such as 0.5:80 or :80, not {shown(value)}'
        )
    return -math.inf if low is None else low, math.inf if high is None else high


def parse_image_size(name: str, value: object) -> tuple[int, int]:
    """Parse the width and the height of images in pixels, such as 1242x375."""
    text = 'x'.join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
    match = _IMAGE_SIZE.fullmatch(text)
    if match is None or not (int(match[1]) and int(match[2])):
        raise UsageError(
            f'{name} takes WIDTHxHEIGHT in pixels, such as 1242x375, not {shown(value)}'
        )
    return int(match[1]), int(match[2])


def parse_shares(name: str, value: object) -> tuple[Fraction, ...]:
    """Parse shares of a whole, such as 0.8 0.2 or 1/3 2/3."""
    from fractions import Fraction  # noqa: PLC0415 - for one command

    if value == ():
        return ()
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    try:
        shares = tuple(Fraction(word) for word in words if _SHARE.fullmatch(word))
    except (ValueError, ZeroDivisionError):
        shares = ()
    if not shares or len(shares) < len(words) or not all(0 < share <= 1 for share in shares):
        given = ' '.join(words)
        raise UsageError(f'{name} takes shares above 0, such as 0.8 0.2, not {shown(given)}')
    return shares
