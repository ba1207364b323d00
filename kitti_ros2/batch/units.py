# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The units of a collection: its drives, sequences and splits, or slices of an object set."""

from __future__ import annotations

import glob
import os
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.find import absolute
from ..kitti.layouts import data_sets_at, open_recording
from ..kitti.nearby import data_set_in, explain, is_inside
from ..model.errors import MissingPathError, UsageError
from ..model.text import some_of
from ..options.read import ReadOptions

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from ..kitti.find import Candidate
    from ..kitti.nearby import DataSet
    from ..model.layouts import Layout

_LIST = '.txt'
_MOST_LEVELS = 8
_FRAME_DIGITS = 6


@dataclass(frozen=True)
class WorkUnit:
    """One unit of work: a recording, or a slice of one.

    Attributes:
        name: Its path below the root of the collection; it names the output, too.
        source: The folder to open.
        layout: Its layout.
        sequence: The recording in the folder; None for the only one.
        first, last: File numbers of a slice, both included; None for all frames.
    """

    name: str
    source: Path
    layout: Layout
    sequence: str | None = None
    first: int | None = None
    last: int | None = None

    @property
    def read(self) -> ReadOptions:
        """Options that open the recording."""
        return ReadOptions(layout=self.layout, sequence=self.sequence)


def find_roots(source: Path) -> list[Path]:
    """Return the folders of a collection: a root itself, the matches of a glob, or a list's.

    A list is a text file with one path per line, relative to the list; # begins a comment.

    Raises:
        KittiRos2Error: There is no such path.
        OSError: The list cannot be read.
    """
    if source.is_file() and source.suffix == _LIST:
        found = list(_listed(source))
        if not found:
            raise UsageError(f'{source}: names no folder; expected one path per line')
    elif source.exists() or not glob.has_magic(str(source)):
        return [source]
    else:
        matches = glob.glob(str(source), recursive=True)  # noqa: PTH207 - it may be absolute
        found = [path for path in map(Path, sorted(matches)) if path.is_dir()]
        if not found:
            raise UsageError(f'{source}: no folder matches; quote the pattern, or give a root')
    for path in found:
        if not path.exists():
            raise MissingPathError(path)
    return list(dict.fromkeys(found))


def _listed(path: Path) -> Iterator[Path]:
    try:
        lines = path.read_text('utf-8').splitlines()
    except UnicodeDecodeError:
        raise UsageError(f'{path}: not UTF-8 text; expected one path per line') from None
    for line in lines:
        text = line.partition('#')[0].strip()
        if text:
            yield path.parent / text


def find_units(
    roots: Sequence[Path], layout: Layout | None = None, slice_frames: int | None = None
) -> list[WorkUnit]:
    """Find the units of a collection, in the order of their names.

    Args:
        roots: Folders: a drive, a data set, or a folder of any number of them.
        layout: Only recordings of this layout; None takes all.
        slice_frames: Frames of a slice of an object set; None does not divide it.

    Raises:
        KittiRos2Error: There is no recording, a layout is ambiguous, or two units have one name.
        OSError: A folder cannot be read.
    """
    base = _common_folder(roots)
    found: dict[tuple[Path, str | None], WorkUnit] = {}
    for root in roots:
        data_sets = list(_data_sets(absolute(root), layout))
        if not data_sets:
            raise explain(root)
        for data_set in data_sets:
            for candidate in data_set.recordings:
                unit = _unit(base, data_set, candidate)
                found.setdefault((unit.source, unit.sequence), unit)
    units = sorted(found.values(), key=lambda unit: unit.name)
    repeated = [name for name, count in Counter(unit.name for unit in units).items() if count > 1]
    if repeated:
        raise UsageError(
            f'{roots[0]}: several recordings are named {some_of(repeated)}; convert them to'
            ' different folders'
        )
    if slice_frames is None:
        return units
    return [part for unit in units for part in _slices(unit, slice_frames)]


def _common_folder(roots: Sequence[Path]) -> Path:
    if len(roots) == 1:
        return absolute(roots[0])
    return Path(os.path.commonpath([absolute(root).parent for root in roots]))


def _unit(base: Path, data_set: DataSet, candidate: Candidate) -> WorkUnit:
    if candidate.folder is None:  # it shares its folders, and has a name in the data set
        place = Path(os.path.relpath(absolute(data_set.folder), base), candidate.name)
        return WorkUnit(
            place.as_posix(), absolute(data_set.folder), data_set.layout, candidate.name
        )
    folder = absolute(candidate.folder)
    place = Path(folder.name) if folder == base else Path(os.path.relpath(folder, base))
    return WorkUnit(place.as_posix(), folder, data_set.layout)


def _data_sets(root: Path, layout: Layout | None) -> Iterator[DataSet]:
    """Yield the data sets at a folder and below it, except within the recordings of another."""
    seen: set[str] = set()
    stack = [(root, 0)]
    while stack:
        folder, level = stack.pop()
        place = os.path.realpath(folder)  # links may lead back
        if place in seen:
            continue
        seen.add(place)
        data_set = data_set_in(folder) if level else _data_set_at(root, layout)
        recordings = () if data_set is None else data_set.recordings
        if data_set is not None and layout in {None, data_set.layout}:
            yield data_set
        if level < _MOST_LEVELS:
            covered = _covered(folder, recordings)
            stack += [(each, level + 1) for each in _folders(folder) if each.name not in covered]


def _data_set_at(root: Path, layout: Layout | None) -> DataSet | None:
    found = data_sets_at(root, ReadOptions(layout=layout))
    return found[0] if found else None


def _covered(folder: Path, recordings: Iterable[Candidate]) -> set[str]:
    """Return the names in a folder that belong to recordings found there."""
    names = set()
    for each in recordings:
        if each.folder is None or each.folder == folder:
            return {entry.name for entry in _folders(folder) if is_inside(entry.name)}
        names.add(each.folder.relative_to(folder).parts[0])
    return names


def _folders(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            names = [each.name for each in entries if each.is_dir() and each.name[0] != '.']
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return []
    return [folder / name for name in sorted(names, reverse=True)]


def _slices(unit: WorkUnit, frames: int) -> list[WorkUnit]:
    """Divide an object split into slices of so many present frames; keep other units whole."""
    if not unit.layout.traits.frame_set:
        return [unit]
    recording = open_recording(unit.source, unit.read)
    present = [index.numbers for index in recording.streams.values()]
    numbers = np.unique(np.concatenate(present)).tolist()
    parts = [numbers[start : start + frames] for start in range(0, len(numbers), frames)]
    return [
        replace(
            unit,
            name=f'{unit.name}/{part[0]:0{_FRAME_DIGITS}d}-{part[-1]:0{_FRAME_DIGITS}d}',
            first=part[0],
            last=part[-1],
        )
        for part in parts
    ]
