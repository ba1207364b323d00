# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsers of one value from a command line, a YAML file or a ROS parameter.

Each function takes the option's name and the value, and raises UsageError if it is invalid.
"""

from __future__ import annotations

import re
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..files.remote import as_path
from ..model.errors import UsageError
from ..model.scan_columns import ScanColumns
from ..model.spelling import not_one_of
from ..model.text import shown

if TYPE_CHECKING:
    from collections.abc import Callable

E = TypeVar('E', bound=Enum)

_WHOLE = re.compile(r'-?\d{1,100}', re.ASCII)
_BEYOND = 10**100


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


def parse_flag(name: str, value: object) -> bool:
    """Parse true or false."""
    if isinstance(value, bool):
        return value
    raise UsageError(f'{name} takes true or false, not {shown(value)}')


def parse_integer(name: str, value: object) -> int:
    """Parse a whole number."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < _BEYOND:
        return value
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    raise UsageError(f'{name} takes a whole number, not {shown(value)}')


def parse_number(name: str, value: object) -> float:
    """Parse a number."""
    if isinstance(value, float):
        return value
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) < _BEYOND:
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


def parse_columns(name: str, value: object) -> ScanColumns:
    """Parse the columns of scans, as a text or a list of words."""
    return ScanColumns.parse(' '.join(parse_texts(name, value)))


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
