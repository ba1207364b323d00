# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of one value from a command line, a YAML file or a ROS parameter.

Each function takes the option's name and the value, and raises UsageError if it is invalid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..files.remote import as_path
from ..model.errors import UsageError
from ..model.least_overlaps import LeastOverlaps
from ..model.spelling import not_one_of
from ..model.stamps import parse_seconds, parse_stamp
from ..model.text import shown

if TYPE_CHECKING:
    from collections.abc import Callable
    from fractions import Fraction

E = TypeVar('E', bound=Enum)

_SIZE = re.compile(r'(\d{1,100}(?:\.\d{1,100})?)\s*([kMGT]?)(i?)B?', re.ASCII)
_WHOLE = re.compile(r'-?\d{1,100}', re.ASCII)
_LEAST_SPLIT_BYTES = 1_000_000
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


def parse_text(name: str, value: object) -> str:
    """Parse a word; a whole number becomes its text."""
    if isinstance(value, (str, int)) and not isinstance(value, bool):
        return str(value)
    raise UsageError(f'{name} takes a word, not {shown(value)}')


def parse_texts(name: str, value: object) -> tuple[str, ...]:
    """Parse a list of words, or words separated by commas or spaces."""
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(
        word for item in items for word in parse_text(name, item).replace(',', ' ').split()
    )


def parse_class_map(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse classes of results with KITTI's, such as car=Car 3=Pedestrian, or a mapping.

    The last = divides a pair; with nothing after it the class is left out.
    """
    return _parse_pairs(name, value, 'NAME=CLASS, such as car=Car 3=Pedestrian')


def parse_labels(name: str, value: object) -> tuple[tuple[str, str], ...]:
    """Parse KITTI's classes with labels of Autoware, such as Van=TRUCK Tram=BUS, or a mapping."""
    return _parse_pairs(name, value, 'CLASS=LABEL, such as Van=TRUCK Tram=BUS')


def _parse_pairs(name: str, value: object, form: str) -> tuple[tuple[str, str], ...]:
    """Parse pairs divided by the last =; nothing may have two partners."""
    if isinstance(value, Mapping):
        pairs = [(str(own), known) for own, known in value.items()]
    else:
        items = value if isinstance(value, (list, tuple)) else [value]
        pairs = [
            item if isinstance(item, tuple) else str(item).rpartition('=')[::2] for item in items
        ]
    for own, known in pairs:
        if not own or not isinstance(known, str) or any(map(str.isspace, known)):
            given = f'{own}={known}' if own else known
            raise UsageError(f'{name} takes {form}, not {given}')
        if dict(pairs)[own] != known:
            raise UsageError(f'{name}: {own} is given twice, as {known} and {dict(pairs)[own]}')
    return tuple(pairs)


def parse_shares(name: str, value: object) -> tuple[Fraction, ...]:
    """Parse shares of a whole, such as 0.8 0.2 or 1/3 2/3."""
    from fractions import Fraction  # noqa: PLC0415 - for one command

    if value == ():
        return ()
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    try:
        shares = tuple(Fraction(word) for word in words)
    except (ValueError, ZeroDivisionError):
        shares = ()
    if not shares or not all(0 < share <= 1 for share in shares):
        given = ' '.join(words)
        raise UsageError(f'{name} takes shares above 0, such as 0.8 0.2, not {shown(given)}')
    return shares


def parse_class_overlaps(name: str, value: object) -> tuple[tuple[str, float | None], ...]:
    """Parse class names, each alone or with an overlap, such as car truck=0.5, or a mapping."""
    if isinstance(value, dict):
        value = [
            each if overlap is None else f'{each}={overlap}' for each, overlap in value.items()
        ]
    pairs = [word.partition('=') for word in parse_texts(name, value)]
    try:
        return tuple(
            (word.lower(), float(overlap) if equals else None) for word, equals, overlap in pairs
        )
    except ValueError:
        given = ' '.join(map(''.join, pairs))
        raise UsageError(
            f'{name} takes names such as car or truck=0.5, not {shown(given)}'
        ) from None


def parse_flag(name: str, value: object) -> bool:
    """Parse true or false."""
    if isinstance(value, bool):
        return value
    raise UsageError(f'{name} takes true or false, not {shown(value)}')


def parse_integer(name: str, value: object) -> int:
    """Parse a whole number."""
    if isinstance(value, int) and not isinstance(value, bool):
        return value
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    raise UsageError(f'{name} takes a whole number, not {shown(value)}')


def parse_number(name: str, value: object) -> float:
    """Parse a number."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str) and value.removeprefix('-').isdecimal():
        return float(value)
    raise UsageError(f'{name} takes a number, not {shown(value)}')


def parse_rounds(name: str, value: object) -> int:
    """Parse a number of rounds; true is endless, false is once."""
    if isinstance(value, bool):
        return 0 if value else 1
    return parse_integer(name, value)


def parse_path(name: str, value: object) -> Path:
    """Parse a path or a URL."""
    return value if isinstance(value, Path) else as_path(parse_text(name, value))


def parse_paths(name: str, value: object) -> tuple[Path, ...]:
    """Parse a path or a list of paths, which may contain blanks and commas."""
    items = value if isinstance(value, (list, tuple)) else [value]
    return tuple(parse_path(name, item) for item in items)


def parse_choice(kind: type[E]) -> Callable[[str, object], E]:
    """Return a parser of the values of an enum."""

    def parse(name: str, value: object) -> E:
        known = [item.value for item in kind]
        if value not in known:
            raise not_one_of(name, value, known)
        return kind(value)

    return parse


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
    except (TypeError, ValueError):
        raise UsageError(
            f'{name} takes three numbers x,y,z in metres, not {shown(value)}'
        ) from None


def parse_four_numbers(name: str, value: object) -> tuple[float, ...]:
    """Parse four numbers in metres: from and to forward, from and to to the left."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(',')
        back, front, right, left = (float(word) for word in words)
    except (ValueError, TypeError):
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


def parse_least_overlaps(name: str, value: object) -> LeastOverlaps:
    """Parse an IoU of all classes, such as 0.5, and those of some, such as Car=0.7."""
    items = value if isinstance(value, (list, tuple)) else [value]
    words = [word for item in items for word in str(item).replace(',', ' ').split()]
    found: dict[str, float] = {}
    for word in words:
        class_name, _, number = word.rpartition('=')
        try:
            found[class_name.lower()] = float(number)
        except ValueError:
            found[class_name.lower()] = math.nan
    valid = all(0 <= overlap < 1 for overlap in found.values())
    if not (words and valid and len(found) == len(words)):
        raise UsageError(
            f'{name} takes an IoU of at least 0 and below 1, such as 0.5, or of a class, such as'
            f' Car=0.5, not {shown(" ".join(words))}'
        )
    others = found.pop('', None)
    return LeastOverlaps(tuple(sorted(found.items())), others)


def parse_span(name: str, value: object) -> tuple[float, float]:
    """Parse the lowest and the highest value, MIN:MAX; an end that is left out is infinite."""
    try:
        words = value if isinstance(value, (list, tuple)) else str(value).split(':')
        low, high = (None if word in (None, '') else float(word) for word in words)
    except (ValueError, TypeError):
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
