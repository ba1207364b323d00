# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Parsing of KITTI's line-based text files: an invalid line becomes an error with its number."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from ..model.errors import BadFileError

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable
    from pathlib import Path

T = TypeVar('T')

_MOST_INVALID = 1000
"""A file with more invalid lines is another kind of file, and an error costs 700 times a line."""

BOM = '\ufeff'
"""The byte order mark that some editors write at the beginning of a file."""


@dataclass(frozen=True)
class Lines(Generic[T]):
    """One value a line; None and an error for an invalid line.

    Attributes:
        values: By line, from 0.
        errors: By line, for the invalid ones.
    """

    values: list[T | None]
    errors: dict[int, BadFileError]

    def __len__(self) -> int:
        return len(self.values)

    def rows(self) -> dict[int, T | BadFileError]:
        """Return what each line is, by line."""
        found: dict[int, T | BadFileError] = {**self.sound(), **self.errors}
        return dict(sorted(found.items()))

    def sound(self) -> dict[int, T]:
        """Return the values of the valid lines, by line."""
        return {line: value for line, value in enumerate(self.values) if value is not None}


def parse_lines(text: str, path: Path | str, expected: str, parse: Callable[[str], T]) -> Lines[T]:
    """Parse each line of a text; a byte order mark, and blank lines at the end, are ignored.

    Args:
        text: The file's content.
        path: For the errors.
        expected: The expected content of a line, for the errors.
        parse: Raises ValueError, with what was found, on an invalid line.

    Raises:
        BadFileError: More than a thousand lines are invalid.
    """
    values: list[T | None] = []
    errors: dict[int, BadFileError] = {}
    for index, line in enumerate(text.removeprefix(BOM).rstrip().splitlines()):
        try:
            values.append(parse(line))
        except ValueError as error:
            values.append(None)
            errors[index] = BadFileError(path, str(error), expected, line=index + 1)
            check_count(errors.values(), path, expected)
    return Lines(values, errors)


def check_columns(
    lines: Iterable[tuple[int, str]], counts: Container[int], path: Path | str, expected: str
) -> None:
    """Refuse a file of another kind, before its lines are parsed.

    Args:
        lines: The number of each, from 1, and its text.
        counts: How many columns a line may have.
        path: For the error.
        expected: The expected content of a line, for the error.

    Raises:
        BadFileError: More than a thousand have another number of columns.
    """
    errors: list[BadFileError] = []
    for number, line in lines:
        found = len(line.split())
        if found not in counts:
            errors.append(BadFileError(path, f'{found} columns', expected, line=number))
            check_count(errors, path, expected)


def check_count(errors: Collection[BadFileError], path: Path | str, expected: str) -> None:
    """Refuse a file with too many invalid lines.

    Raises:
        BadFileError: There are more than a thousand.
    """
    if len(errors) > _MOST_INVALID:
        first = next(iter(errors)).line
        found = f'this and {_MOST_INVALID} more lines, maybe all, are invalid; the file is not read'
        raise BadFileError(path, found, expected, line=first)


def parse_numbers(words: list[str], count: int) -> list[float]:
    """Parse words into finite floats.

    Raises:
        ValueError: Their count is different, or one is no finite number.
    """
    if len(words) != count:
        raise ValueError(f'{len(words)} values')
    numbers = []
    for word in words:
        try:
            number = float(word)
        except ValueError:
            raise ValueError(f'{word!r} is no number') from None
        if not math.isfinite(number):
            raise ValueError(f'{word!r} is no finite number')
        numbers.append(number)
    return numbers
