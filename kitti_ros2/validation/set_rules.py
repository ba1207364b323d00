# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the lists of frames of an object set, ImageSets/*.txt."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

from ..kitti import names
from ..kitti.store import STORE
from ..kitti.text_file import Lines, parse_lines
from ..model.errors import BadFileError
from ..model.losses import format_numbers
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

_DISJOINT = frozenset({'train', 'val', 'test'})
_WHOLE = 'trainval'
_TEST = 'test'


@dataclass(frozen=True, eq=False)
class SplitLists:
    """The lists of frames of a set.

    Attributes:
        folder: ImageSets.
        lists: The frame numbers by name of the list, without suffix; an error if it is unreadable.
        frames: The numbers of the frames by split (training, testing).
    """

    folder: Path
    lists: Mapping[str, Lines[int] | BadFileError | OSError]
    frames: Mapping[str, frozenset[int]]

    @classmethod
    def read(
        cls,
        root: Path,
        frames: Mapping[str, frozenset[int]],
        known: Mapping[str, names.FileNames] | None = None,
    ) -> SplitLists:
        """Read the lists of a set.

        Args:
            root: The set.
            frames: The numbers of the frames by split.
            known: How they are named, by split.
        """
        ways = [*(known or {}).values()] or [names.SIX_DIGITS]
        folder = root / names.IMAGE_SETS
        found: dict[str, Lines[int] | BadFileError | OSError] = {}
        for name in STORE.names(folder):
            if name.endswith(names.TXT):
                path = folder / name
                try:
                    text = STORE.read_text(path)
                    found[path.stem] = _parse(text, path, ways)
                except (BadFileError, OSError) as error:
                    found[path.stem] = error
        return cls(folder, found, frames)

    def path(self, name: str) -> Path:
        """Return the file of a list."""
        return self.folder / f'{name}{names.TXT}'

    def numbers(self) -> dict[str, dict[int, int]]:
        """Return by list the first line of each number, from 1."""
        found: dict[str, dict[int, int]] = {}
        for name, lines in self.lists.items():
            first = found.setdefault(name, {})
            for line, number in lines.sound().items() if isinstance(lines, Lines) else ():
                first.setdefault(number, line + 1)
        return found

    def frames_of(self, name: str) -> frozenset[int] | None:
        """Return the frames that a list chooses from; None if the split is not there."""
        training, testing = (self.frames.get(split) for split in names.SPLITS)
        if name == _TEST:
            return testing if testing is not None else None
        return training if name in {*_DISJOINT, _WHOLE} else (training or testing)


def _parse(text: str, path: Path, ways: Sequence[names.FileNames]) -> Lines[int]:
    """Parse a list; its frames are of one split, training first."""
    found = [parse_lines(text, path, 'a frame number', partial(_parse_number, way)) for way in ways]
    return min(found, key=lambda lines: len(lines.errors))


def _parse_number(known: names.FileNames, line: str) -> int:
    number = known.number(line.strip())
    if number is None:
        raise ValueError(f'{line.strip()[:40]!r}')
    return number


def _find_invalid(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.lists.items():
        errors = lines.errors.values() if isinstance(lines, Lines) else [lines]
        for error in errors:
            yield breach_of(error, splits.path(name))


def _find_absent(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.numbers().items():
        frames = splits.frames_of(name)
        absent = [] if frames is None else sorted(lines.keys() - frames)
        if absent:
            text = f'{len(absent)} of {len(lines)} frames do not exist: {format_numbers(absent)}'
            yield Breach(text, splits.path(name), min(lines[number] for number in absent))


def _find_repeated(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.lists.items():
        first: dict[int, int] = {}
        for line, number in lines.sound().items() if isinstance(lines, Lines) else ():
            if first.setdefault(number, line + 1) != line + 1:
                text = f'frame {number} again, first in line {first[number]}'
                yield Breach(text, splits.path(name), line + 1)


def _find_overlap(splits: SplitLists) -> Iterator[Breach]:
    numbers = splits.numbers()
    chosen = [name for name in numbers if name in _DISJOINT]
    for one, other in combinations(chosen, 2):
        # The frames of testing have numbers of their own.
        separate = _TEST in (one, other) and 'testing' in splits.frames
        common = [] if separate else sorted(numbers[one].keys() & numbers[other].keys())
        if common:
            text = f'{len(common)} frames are in {other}.txt, too: {format_numbers(common)}'
            yield Breach(text, splits.path(one), min(numbers[one][each] for each in common))


def _find_unlike_whole(splits: SplitLists) -> Iterator[Breach]:
    numbers = splits.numbers()
    if {'train', 'val', _WHOLE} <= numbers.keys():
        parts = numbers['train'].keys() | numbers['val'].keys()
        differing = sorted(parts ^ numbers[_WHOLE].keys())
        if differing:
            text = f'frames {format_numbers(differing)} are not both here and in train or val'
            yield Breach(text, splits.path(_WHOLE))


_SET, _ERROR, _WARNING = RuleScope.SET, RuleSeverity.ERROR, RuleSeverity.WARNING

SET_RULES: tuple[Rule[SplitLists], ...] = (
    Rule(
        'split-line',
        _ERROR,
        _SET,
        'Lists of frames (ImageSets) have a frame number a line',
        'correct the line',
        _find_invalid,
    ),
    Rule(
        'split-frame',
        _ERROR,
        _SET,
        'Frames of the lists exist',
        'remove them from the list, or copy the missing frames',
        _find_absent,
    ),
    Rule(
        'split-overlap',
        _ERROR,
        _SET,
        'train, val and test have no frame in common',
        'remove the frames from one list: results on them mean nothing',
        _find_overlap,
    ),
    Rule(
        'split-repeated',
        _WARNING,
        _SET,
        'Lists have each frame once',
        'remove the second line',
        _find_repeated,
    ),
    Rule(
        'split-whole',
        _WARNING,
        _SET,
        'trainval has the frames of train and val',
        'write the list again from the two others',
        _find_unlike_whole,
    ),
)
