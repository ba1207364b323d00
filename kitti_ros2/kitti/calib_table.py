# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The common format of KITTI's calibration files: lines of a key, then numbers or words.

``P0: 7.2e+02 ...``, in tracking partly without the colon (``R_rect 9.9e-01 ...``). Some values are
words (``calib_time: 09-Jan-2012 13:57:47``); numbers are only parsed on request.

Exporters of other data sets write placeholders where a rig lacks a sensor: an empty value (View of
Delft's Tr_imu_to_velo) or a matrix of zeros (P0, P1, P3 of nuScenes' export_kitti.py). Their keys
count as absent.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError
from ..model.geometry import Transform
from .text_file import parse_numbers

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.geometry import Float64Array

_MATRIX_SIZES = frozenset({0, 1, 9, 12})
"""How many zeros make a placeholder; vectors (T, D, S of 3, 5 and 2 numbers) may be zero."""

_LINE = re.compile(r'(?P<key>[A-Za-z]\w*)(?::|\s)\s*(?P<value>.*)')


@dataclass(frozen=True)
class CalibTable:
    """The keys of one calibration file, with their line numbers.

    Attributes:
        path: The file.
        entries: Key to line number and value.
        placeholders: Keys without a value, with their line numbers; not among the entries.
    """

    path: Path
    entries: Mapping[str, tuple[int, str]]
    placeholders: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str, path: Path) -> CalibTable:
        """Split a file's text by key.

        Raises:
            BadFileError: A line has no key, or the file has no line.
        """
        entries: dict[str, tuple[int, str]] = {}
        placeholders: dict[str, int] = {}
        for number, line in enumerate(text.splitlines(), 1):
            if not line.strip():
                continue
            match = _LINE.fullmatch(line.strip())
            if match is None:
                raise BadFileError(
                    path, f'{line[:40]!r}', 'a line like "P0: 7.2e+02 ..."', line=number
                )
            if _is_placeholder(match['value'].split()):
                placeholders[match['key']] = number
            else:
                entries[match['key']] = (number, match['value'])
        if not entries and not placeholders:
            raise BadFileError(path, 'the file is empty', 'calibration lines such as "P0: ..."')
        return cls(path, entries, placeholders)

    def absence(self, *keys: str) -> str:
        """Return the reason why none of keys has a value, with the line of a placeholder."""
        for key in keys:
            if key in self.placeholders:
                line = self.placeholders[key]
                return f'{self.path}: no {key} (line {line} is empty or zeros)'
        return f'{self.path}: no {keys[0]}'

    def numbers(self, count: int, *keys: str) -> Float64Array | None:
        """Return the numbers of the first of keys that exists, None without any.

        Raises:
            BadFileError: Their count is not count, or one is no finite number.
        """
        for key in keys:
            if key in self.entries:
                line, value = self.entries[key]
                try:
                    return np.array(parse_numbers(value.split(), count))
                except ValueError as error:
                    raise BadFileError(
                        self.path, f'{key}: {error}', f'{count} numbers', line=line
                    ) from None
        return None

    def projection(self, *keys: str) -> Float64Array | None:
        """Return a (3, 4) projection whose left (3, 3) is invertible, None without the key.

        Raises:
            BadFileError: As numbers, or the matrix is singular.
        """
        values = self.numbers(12, *keys)
        if values is None:
            return None
        matrix = values.reshape(3, 4)
        if abs(np.linalg.det(matrix[:, :3])) < 1e-9:
            line = next(self.entries[key][0] for key in keys if key in self.entries)
            raise BadFileError(
                self.path, f'{keys[0]} is singular', 'a projection matrix', line=line
            )
        return matrix

    def rotation(self, *keys: str) -> Float64Array | None:
        """Return a (3, 3) rotation, None without the key.

        Raises:
            BadFileError: As numbers, or the matrix is no rotation to 1e-3.
        """
        values = self.numbers(9, *keys)
        return None if values is None else self._checked_rotation(values.reshape(3, 3), keys)

    def transform(self, *keys: str) -> Transform | None:
        """Return the transform of a (3, 4) matrix [R | t], None without the key.

        Raises:
            BadFileError: As numbers, or R is no rotation to 1e-3.
        """
        values = self.numbers(12, *keys)
        if values is None:
            return None
        matrix = values.reshape(3, 4)
        return Transform(self._checked_rotation(matrix[:, :3].copy(), keys), matrix[:, 3].copy())

    def transform_parts(self, rotation_key: str, translation_key: str) -> Transform | None:
        """Return the transform of a rotation and a translation under two keys."""
        rotation = self.rotation(rotation_key)
        translation = self.numbers(3, translation_key)
        if rotation is None or translation is None:
            return None
        return Transform(rotation, translation)

    def _checked_rotation(self, matrix: Float64Array, keys: tuple[str, ...]) -> Float64Array:
        with np.errstate(over='ignore', invalid='ignore'):  # no rotation where the result is NaN
            error = np.abs(matrix @ matrix.T - np.eye(3)).max()
        if not error <= 1e-3 or np.linalg.det(matrix) < 0:
            key, line = next((key, self.entries[key][0]) for key in keys if key in self.entries)
            raise BadFileError(
                self.path, f'{key} holds no rotation', 'an orthonormal matrix', line=line
            )
        return matrix


def _is_placeholder(words: list[str]) -> bool:
    """Whether a value is empty, or a matrix of zeros or NaN."""
    if len(words) not in _MATRIX_SIZES:
        return False
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return False
    return all(number == 0 or math.isnan(number) for number in numbers)
