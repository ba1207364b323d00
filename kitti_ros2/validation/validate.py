# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Validation of all data sets and bags at some paths, by the table of rules."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

from ..bags.locate import METADATA, bags_among, is_bag_name
from ..files.remote import as_path
from ..kitti import names
from ..kitti.find import absolute
from ..kitti.opening import data_sets_at, data_sets_below, explain, not_of_layout
from ..kitti.store import STORE, cached_listings
from ..kitti.text_file import Lines, parse_lines
from ..model.bag_formats import CONTAINERS
from ..model.errors import BadFileError, UsageError, format_numbers, naming
from ..options.datasets import make_validation_options
from .file_rules import CALIBRATION_RULES, FILE_RULES, LABEL_RULES
from .frame_rules import (
    FRAME_RULES,
    IMAGE_RULES,
    LABEL_FRAME_RULES,
    SCAN_FRAME_RULES,
    SCAN_RULES,
    TRACKLET_RULES,
)
from .recording_checks import check_recording
from .recording_rules import OXTS_RULES, POSE_RULES, RECORDING_RULES, STAMP_RULES
from .rule import (
    ERROR,
    SOURCE_RULES,
    WARNING,
    Breach,
    FindingTally,
    Rule,
    RuleScope,
    RuleTable,
    Unopened,
    breach_of,
    find_breaches,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from typing_extensions import Unpack

    from ..kitti.names import FileNames
    from ..kitti.opening import DataSet
    from ..model.errors import KittiRos2Error
    from ..options.keywords import ValidateKeywords
    from ..options.read import ReadOptions, ValidateOptions
    from .rule import CheckedSource, ValidationReport


# The data sets with their recordings, and the bags, at a path.


class PathSources(NamedTuple):
    """The data sets and bags at a path.

    Attributes:
        data_sets: Folders with recordings.
        bags: Bags, files or folders.
        unopened: Folders that were not searched, or not to the end.
    """

    data_sets: list[DataSet]
    bags: list[Path]
    unopened: Sequence[Unopened] = ()


@cached_listings()
def find_sources(path: Path, options: ReadOptions) -> PathSources:
    """Find the data sets and bags at a path and below it.

    Args:
        path: A KITTI folder, a folder of several, a bag, or a folder of bags.
        options: The only layout and sequence to check, if given.

    Raises:
        KittiRos2Error: There is nothing to check; or the layout is ambiguous.
        OSError: The folder cannot be read.
    """
    if not path.is_dir():
        if path.is_file() and _is_bag_file(path):  # opening a pipe would wait
            return PathSources([], [path])
        raise _explain_file(path) if path.is_file() else explain(path)
    if (path / METADATA).is_file():
        return PathSources([], [path])
    data_sets = [data._replace(folder=absolute(path)) for data in data_sets_at(path, options)]
    bags = list(_bags_in(path)) if options.layout is None else []
    if options.layout is not None and not data_sets:
        raise not_of_layout(path, options.layout)
    if data_sets and (options.layout is not None or options.sequence is not None):
        return PathSources(data_sets, bags)
    unopened: list[Unopened] = []

    def visit(folder: Path) -> None:
        try:
            bags.extend(_bags_in(folder))
        except OSError as error:
            unopened.append(Unopened(folder, error))

    below, complete = data_sets_below(path, data_sets, visit)
    if not data_sets and not below and not bags:
        raise explain(path)
    unopened += [] if complete else [Unopened(path)]
    return PathSources([*data_sets, *below], bags, unopened)


def _explain_file(path: Path) -> KittiRos2Error:
    from ..bags.bag_files import explain_file  # noqa: PLC0415 - readers of bags, for errors only

    return explain_file(path)


def _is_bag_file(path: Path) -> bool:
    with naming(path), path.open('rb') as file:
        head = file.read(16)
    has_magic = any(head.startswith(container.magic) for container in CONTAINERS.values())
    return has_magic or is_bag_name(path)


def _bags_in(folder: Path) -> Iterator[Path]:
    """Yield the bags in a folder that is none: single files, and rosbag2 directories."""
    names = STORE.names(folder)
    if METADATA in names and (folder / METADATA).is_file():
        return
    yield from (bag for bag in bags_among(folder, names) if bag == folder or bag.is_file())
    for name in names:
        if (folder / name / METADATA).is_file():
            yield folder / name


# Rules about the lists of frames of an object set, ImageSets/*.txt.

_DISJOINT = frozenset({'train', 'val', 'test'})
_WHOLE = 'trainval'
_TEST = 'test'


@dataclass(frozen=True, eq=False)
class SplitLists:
    """The lists of frames of a set.

    Attributes:
        folder: ImageSets.
        lists: The frame numbers by name of the list, without suffix; else its error.
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
        file_names: Mapping[str, names.FileNames] | None = None,
    ) -> SplitLists:
        """Read the lists of a set.

        Args:
            root: The set.
            frames: The numbers of the frames by split.
            file_names: Their file names, by split.
        """
        ways = [*(file_names or {}).values()] or [names.SIX_DIGITS]
        folder = root / names.IMAGE_SETS
        lists: dict[str, Lines[int] | BadFileError | OSError] = {}
        for name in STORE.names(folder):
            if name.endswith(names.TXT):
                path = folder / name
                try:
                    text = STORE.read_text(path)
                    lists[path.stem] = _parse(text, path, ways)
                except (BadFileError, OSError) as error:
                    lists[path.stem] = error
        return cls(folder, lists, frames)

    def path(self, name: str) -> Path:
        """Return the file of a list."""
        return self.folder / f'{name}{names.TXT}'

    def numbers(self) -> dict[str, dict[int, int]]:
        """Return the first line of each number, from 1, by list."""
        first_lines: dict[str, dict[int, int]] = {}
        for name, lines in self.lists.items():
            first = first_lines.setdefault(name, {})
            for line, number in lines.sound().items() if isinstance(lines, Lines) else ():
                first.setdefault(number, line + 1)
        return first_lines

    def frames_of(self, name: str) -> frozenset[int] | None:
        """Return the frames of the split of a list; None if the split is missing."""
        training, testing = (self.frames.get(split) for split in names.SPLITS)
        if name == _TEST:
            return testing if testing is not None else None
        return training if name in {*_DISJOINT, _WHOLE} else (training or testing)


def _parse(text: str, path: Path, ways: Sequence[names.FileNames]) -> Lines[int]:
    """Parse a list; its frames are of one split, training first."""
    lists = [parse_lines(text, path, 'a frame number', partial(_parse_number, way)) for way in ways]
    return min(lists, key=lambda lines: len(lines.errors))


def _parse_number(file_names: names.FileNames, line: str) -> int:
    number = file_names.number(line.strip())
    if number is None:
        raise ValueError(f'{line.strip()[:40]!r}')
    return number


SET_RULES = RuleTable[SplitLists](RuleScope.SET)


@SET_RULES.add(
    'split-line',
    ERROR,
    'Lists of frames (ImageSets) have a frame number a line',
    'correct the line',
)
def _find_invalid(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.lists.items():
        errors = lines.errors.values() if isinstance(lines, Lines) else [lines]
        for error in errors:
            yield breach_of(error, splits.path(name))


@SET_RULES.add(
    'split-frame',
    ERROR,
    'Frames of the lists exist',
    'remove them from the list, or copy the missing frames',
)
def _find_absent(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.numbers().items():
        frames = splits.frames_of(name)
        absent = [] if frames is None else sorted(lines.keys() - frames)
        if absent:
            text = f'{len(absent)} of {len(lines)} frames do not exist: {format_numbers(absent)}'
            yield Breach(text, splits.path(name), min(lines[number] for number in absent))


@SET_RULES.add(
    'split-overlap',
    ERROR,
    'train, val and test have no frame in common',
    'remove the frames from one list: results on them mean nothing',
)
def _find_overlap(splits: SplitLists) -> Iterator[Breach]:
    numbers = splits.numbers()
    disjoint = [name for name in numbers if name in _DISJOINT]
    for one, other in combinations(disjoint, 2):
        # The frames of testing have separate numbers.
        separate = _TEST in (one, other) and 'testing' in splits.frames
        common = [] if separate else sorted(numbers[one].keys() & numbers[other].keys())
        if common:
            text = f'{len(common)} frames are in {other}.txt, too: {format_numbers(common)}'
            yield Breach(text, splits.path(one), min(numbers[one][number] for number in common))


@SET_RULES.add('split-repeated', WARNING, 'Lists have each frame once', 'remove the second line')
def _find_repeated(splits: SplitLists) -> Iterator[Breach]:
    for name, lines in splits.lists.items():
        first: dict[int, int] = {}
        for line, number in lines.sound().items() if isinstance(lines, Lines) else ():
            if first.setdefault(number, line + 1) != line + 1:
                text = f'frame {number} again, first in line {first[number]}'
                yield Breach(text, splits.path(name), line + 1)


@SET_RULES.add(
    'split-whole',
    WARNING,
    'trainval has the frames of train and val',
    'write the list again from the two others',
)
def _find_unlike_whole(splits: SplitLists) -> Iterator[Breach]:
    numbers = splits.numbers()
    if {'train', 'val', _WHOLE} <= numbers.keys():
        parts = numbers['train'].keys() | numbers['val'].keys()
        differing = sorted(parts ^ numbers[_WHOLE].keys())
        if differing:
            text = f'frames {format_numbers(differing)} are not both here and in train or val'
            yield Breach(text, splits.path(_WHOLE))


# All rules, in the order of the documentation.

FOLDER_RULES: tuple[Rule[Any], ...] = (
    *SOURCE_RULES,
    *FILE_RULES,
    *SCAN_RULES,
    *IMAGE_RULES,
    *CALIBRATION_RULES,
    *LABEL_RULES,
    *TRACKLET_RULES,
    *LABEL_FRAME_RULES,
    *SCAN_FRAME_RULES,
    *FRAME_RULES,
    *STAMP_RULES,
    *OXTS_RULES,
    *POSE_RULES,
    *RECORDING_RULES,
    *SET_RULES,
)
"""Rules about KITTI folders, and about the arguments."""


def rules_by_id(*, bags: bool) -> dict[str, Rule[Any]]:
    """Return the rules by id; those about bags only if needed, as messages take 0.1 s."""
    rules: Sequence[Rule[Any]] = FOLDER_RULES
    if bags:
        from .bag_rules import BAG_RULES, MESSAGE_RULES, TOPIC_RULES  # noqa: PLC0415 - see above

        rules = (*FOLDER_RULES, *BAG_RULES, *TOPIC_RULES, *MESSAGE_RULES)
    return {rule.id: rule for rule in rules}


if TYPE_CHECKING:
    AnyPath = str | os.PathLike[str]
    Progress = Callable[[int, int], None]


def validate(
    path: AnyPath | Iterable[AnyPath],
    *,
    progress: Progress | None = None,
    **options: Unpack[ValidateKeywords],
) -> ValidationReport:
    """Check KITTI folders and bags, as `kitti-ros2 validate` does.

    Every file of every recording at a path is checked: size, content, agreement with others.
    Memory does not grow with the number of files.

    Args:
        path: A KITTI folder, a folder of several, a bag, or several of these.
        progress: Called with the frames or messages done and the number of all, of the current
            recording or bag.
        options: Options of `kitti-ros2 validate --help-all`: layout, sequence, columns, quick,
            decode.

    Returns:
        The findings by rule, with severity, file, line and remedy; ok without errors.

    Raises:
        KittiRos2Error: There is nothing to check at a path, or an option is invalid.

    Examples:
        >>> from kitti_ros2.datasets import validate
        >>> validate('object').ok
        True
    """
    read, check_options = make_validation_options({**options})
    paths = [path] if isinstance(path, (str, os.PathLike)) else list(path)
    if not paths:
        raise UsageError('no path; expected at least one')
    contents = [find_sources(source, read) for source in dict.fromkeys(map(as_path, paths))]
    tally = FindingTally(rules_by_id(bags=any(content.bags for content in contents)))
    show = progress or (lambda _done, _total: None)
    sources: list[CheckedSource] = []
    for content in contents:
        for data_set in content.data_sets:
            sources += _check_data_set(data_set, read, check_options, tally, show)
        sources += _check_bags(content.bags, check_options, tally, show)
        for unopened in content.unopened:
            tally.add(find_breaches(SOURCE_RULES, unopened))
    return tally.report(sources)


def _check_bags(
    bags: Sequence[Path], options: ValidateOptions, tally: FindingTally, progress: Progress
) -> Iterator[CheckedSource]:
    if bags:
        from .bag_checks import check_bag  # noqa: PLC0415 - readers of bags take 0.2 s

        for bag in bags:
            yield check_bag(bag, options, tally, progress)


def _check_data_set(
    data_set: DataSet,
    read: ReadOptions,
    options: ValidateOptions,
    tally: FindingTally,
    progress: Progress,
) -> Iterator[CheckedSource]:
    """Check all recordings of a data set, and its lists of frames."""
    frames: dict[str, frozenset[int]] = {}
    file_names: dict[str, FileNames] = {}
    for candidate in data_set.recordings:
        source, numbers, file_names[candidate.name] = check_recording(
            candidate,
            data_set.layout,
            read,
            data_set.folder,
            options,
            tally,
            progress,
        )
        if data_set.layout.traits.frame_set:
            frames[candidate.name] = frozenset(numbers)
        yield source
    if frames:
        folders = [
            recording.folder for recording in data_set.recordings if recording.folder is not None
        ]
        splits = SplitLists.read(folders[0].parent, frames, file_names)
        tally.add(find_breaches(SET_RULES, splits))
