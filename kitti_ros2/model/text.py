# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Text for people: safe single lines, and quantities with their units."""

from __future__ import annotations

import re
from reprlib import Repr
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_LONGEST, _END = 2000, 400  # of a line, and of its end where the middle is left out
_SHORT = Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 200

# Of longer words only the beginning and the end are shown.
_LONG_WORD = re.compile(r'(\S{120})\S{200,}(\S{60})')


def one_line(text: str) -> str:
    r"""Remove line breaks and control characters from a text.

    Names of topics, frames and types in a bag are arbitrary. What is not printable (control
    characters, marks that change the direction of writing, bytes of file names that are not UTF-8)
    is written as in a Python string, such as \x1b; of very long words and lines the middle is left
    out.
    """
    line = ' '.join(text.split())
    if not line.isprintable():
        line = ''.join(each if each.isprintable() else _escaped(each) for each in line)
    line = _LONG_WORD.sub(r'\1...\2', line)
    return line if len(line) <= _LONGEST else f'{line[: _LONGEST - _END - 3]}...{line[-_END:]}'


def shown(value: object) -> str:
    """Return a value as Python writes it, shortened: those of a YAML file are of any size."""
    return _SHORT.repr(value)


def _escaped(character: str) -> str:
    return character.encode('unicode_escape').decode('ascii')


def format_bytes(count: float) -> str:
    """Format a size such as 434.9 MB."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:
            return f'{count:.0f} {unit}' if unit == 'B' else f'{count:.1f} {unit}'
        count /= 1000
    return f'{count:.1f} TB'


def format_duration(nanoseconds: int) -> str:
    """Format a duration such as 12.4 s or 7 min 30 s."""
    seconds = nanoseconds / 1e9
    if seconds < 120:
        return f'{seconds:.1f} s'
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes} min {rest} s'


def format_count(count: int, noun: str) -> str:
    """Format a count with its noun, such as 1 message or 2,104 messages."""
    return f'{count:,} {noun}{"" if count == 1 else "s"}'


def either(names: Sequence[str]) -> str:
    """Format a choice, such as a, b or c."""
    return ' or '.join(', '.join(names).rsplit(', ', 1))


def some_of(names: Sequence[str], most: int = 3) -> str:
    """Format the first few of many names, such as a, b, c and 5 more."""
    return ', '.join(names[:most]) + (f' and {len(names) - most} more' if len(names) > most else '')
