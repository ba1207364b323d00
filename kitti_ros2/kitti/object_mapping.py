# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The object devkit's mapping: the raw drive and file number of each object training frame.

train_mapping.txt: one line a drive frame, ``2011_09_26 2011_09_26_drive_0005_sync 0000000109``.
train_rand.txt: line numbers of that file, from 1, separated by commas, a permutation: value k
(from 0) is the line of object frame k. Both have 7481 entries; the testing frames have no mapping.
Source: readme.txt of the object devkit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ..model.errors import BadFileError, UsageError
from ..model.text import either, format_count
from . import names
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

MAPPING = 'train_mapping.txt'
RAND = 'train_rand.txt'

_LINE = re.compile(r'(\d{4}_\d{2}_\d{2}) (\1_drive_\d{4}_(?:sync|extract)) (\d{1,10})', re.ASCII)
_BELOW = ('', 'mapping', 'object/mapping', 'devkit/mapping', 'devkit/object/mapping',
          'devkit_object/mapping', 'devkit_object/devkit/mapping')  # fmt: skip
"""Folders of the mapping within a folder that a user names, or beside or in the object set."""


class DriveFrame(NamedTuple):
    """A file number of a raw drive.

    Attributes:
        drive: Such as 2011_09_26_drive_0005_sync.
        number: The file number.
    """

    drive: str
    number: int

    @property
    def date(self) -> str:
        """The folder that holds the drive."""
        return self.drive[: len('2011_09_26')]


@dataclass(frozen=True)
class ObjectMapping:
    """The drive frames of the object training frames.

    Attributes:
        folder: The folder of both files.
        frames: By object frame.
    """

    folder: Path
    frames: tuple[DriveFrame, ...]

    def get(self, number: int) -> DriveFrame | None:
        """Return the drive frame of an object frame; None beyond the mapping."""
        return self.frames[number] if number < len(self.frames) else None

    @property
    def beyond(self) -> str:
        """The reason why a frame has no drive."""
        return f'{self.folder / RAND}: {len(self.frames)} numbers, so no drive'


def find_mapping(root: Path, given: Path | None = None) -> ObjectMapping:
    """Read the mapping in a given folder, or else in, beside or above an object set.

    Args:
        root: The folder of training and testing, absolute.
        given: A folder of the devkit, or of the mapping itself.

    Raises:
        UsageError: There is none.
        BadFileError: It is invalid.
        OSError: It cannot be read.
    """
    places = (root, root.parent) if given is None else (given,)
    for folder in (place / below for place in places for below in _BELOW):
        if (folder / MAPPING).is_file() and (folder / RAND).is_file():
            return read_mapping(folder)
    where = f'in or beside {root}' if given is None else f'in {given}'
    raise UsageError(
        f'no {MAPPING} and {RAND} {where}; they are in devkit_object.zip of KITTI:'
        f' give their folder with --mapping'
    )


def read_mapping(folder: Path) -> ObjectMapping:
    """Read the mapping in a folder.

    Raises:
        BadFileError: A line is invalid, or the numbers are no permutation of the lines.
        OSError: A file cannot be read.
    """
    lines = parse_mapping(STORE.read_text(folder / MAPPING), folder / MAPPING)
    order = parse_rand(STORE.read_text(folder / RAND), folder / RAND, len(lines))
    return ObjectMapping(folder, tuple(lines[line - 1] for line in order))


def parse_mapping(text: str, path: Path) -> list[DriveFrame]:
    """Parse train_mapping.txt.

    Raises:
        BadFileError: A line is invalid or repeated, or there is none.
    """
    found: dict[DriveFrame, int] = {}
    for place, line in enumerate(text.rstrip().splitlines(), 1):
        match = _LINE.fullmatch(line.strip())
        if match is None:
            expected = 'date, drive and number such as 2011_09_26 2011_09_26_drive_0005_sync 12'
            raise BadFileError(path, f'{line.strip()!r}', expected, line=place)
        frame = DriveFrame(match[2], int(match[3]))
        if frame in found:
            what = f'{frame.drive} {frame.number} is in line {found[frame]} as well'
            raise BadFileError(path, what, 'each frame once', line=place)
        found[frame] = place
    if not found:
        raise BadFileError(path, 'no line', 'one line for each object training frame')
    return [*found]


def parse_rand(text: str, path: Path, lines: int) -> list[int]:
    """Parse train_rand.txt: line numbers of the mapping, from 1.

    Args:
        text: Its content.
        path: For the errors.
        lines: Number of lines of train_mapping.txt.

    Raises:
        BadFileError: It is no permutation of the line numbers.
    """
    expected = f'each line of {MAPPING} once, 1 to {lines}'
    order: dict[int, int] = {}
    words = text.replace(',', ' ').split()
    for place, word in enumerate(words, 1):
        number = int(word) if word.isascii() and word.isdecimal() and len(word) < 10 else 0
        if not 1 <= number <= lines:
            raise BadFileError(path, f'number {place} is {word!r}', expected)
        if number in order:
            what = f'numbers {order[number]} and {place} are both {number}'
            raise BadFileError(path, what, expected)
        order[number] = place
    if len(order) != lines:
        raise BadFileError(path, format_count(len(order), 'number'), expected)
    return [*order]


def find_raw_root(root: Path, given: Path | None = None) -> Path:
    """Return the folder of the raw drives: a given one, or else beside an object set.

    Args:
        root: The folder of training and testing, absolute.
        given: A folder of dates, or of the drives themselves.

    Raises:
        UsageError: There is none.
    """
    if given is not None:
        if not given.is_dir():
            raise UsageError(f'{given}: no such folder; --raw takes the folder of the raw drives')
        return given
    for place in (root / 'raw', root.parent / 'raw', root.parent / 'raw_data', root.parent):
        if any(names.RAW_DATE.fullmatch(name) for name in STORE.names(place)):
            return place
    asked = either([f'{root.parent}/raw', f'{root.parent}/raw_data'])
    raise UsageError(
        f'no raw drives beside {root} (in {asked}); give their folder with --raw,'
        f' of their archives {names.TIMESTAMPS} in each stream is enough'
    )
