# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Units of work; those of recordings: drives, sequences, splits, or slices of an object set."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..files.remote import is_remote, real_place, relative_place
from ..files.staging import refuse_inside
from ..kitti.find import absolute
from ..kitti.layouts import data_sets_at, open_recording
from ..kitti.nearby import data_set_in, explain, is_inside
from ..model.errors import UsageError
from ..model.text import some_of
from ..options.read import ReadOptions
from .folders import FolderSearch, common_folder, relative_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from ..kitti.find import Candidate
    from ..kitti.nearby import DataSet
    from ..model.layouts import Layout

_FRAME_DIGITS = 6


@dataclass(frozen=True)
class WorkUnit:
    """One unit of work: a recording, a slice of one, a bag, or a result with its ground truth.

    Attributes:
        name: Its path below the root of the collection; it names the output, too.
        source: The folder or file to open.
        layout: Its layout; None for a bag, or another file.
        sequence: The recording in the folder; None for the only one.
        first, last: File numbers of a slice, both included; None for all frames.
        result: What is compared with the source; None for nothing.
    """

    name: str
    source: Path
    layout: Layout | None = None
    sequence: str | None = None
    first: int | None = None
    last: int | None = None
    result: Path | None = None

    @property
    def read(self) -> ReadOptions:
        """Options that open the recording."""
        return ReadOptions(layout=self.layout, sequence=self.sequence)

    @cached_property
    def origin(self) -> str:
        """What it is made from, as text."""
        against = '' if self.result is None else f'{self.result} with '
        return f'{against}{self.source}'


def find_units(
    roots: Sequence[Path],
    layout: Layout | None = None,
    slice_frames: int | None = None,
    search: FolderSearch | None = None,
) -> list[WorkUnit]:
    """Find the recordings of a collection, in the order of their names.

    Args:
        roots: Folders: a drive, a data set, or a folder of any number of them.
        layout: Only recordings of this layout; None takes all.
        slice_frames: Frames of a slice of an object set; None does not divide it.
        search: Knows which folders are left out; gets those that could not be read.

    Raises:
        KittiRos2Error: There is no recording, a layout is ambiguous, or two units have one name.
        OSError: A root cannot be read.
    """
    base = common_folder(roots)
    search = search or FolderSearch()
    found: dict[tuple[Path, str | None], WorkUnit] = {}
    for root in roots:
        units = recordings_at(root, base, layout, search) if root.is_dir() else []
        if not units:
            raise search.nothing() or explain(root)
        for unit in units:
            found.setdefault((unit.source, unit.sequence), unit)
    units = in_order(found.values(), roots)
    if slice_frames is None:
        return units
    return [part for unit in units for part in _slices(unit, slice_frames)]


def recordings_at(
    root: Path, base: Path, layout: Layout | None, search: FolderSearch
) -> list[WorkUnit]:
    """Return the recordings at a folder and below it, except within the recordings of another.

    Args:
        root: The folder.
        base: What names are relative to.
        layout: Only recordings of this layout; None takes all.
        search: As in find_units.
    """
    place = absolute(root)
    found: list[WorkUnit] = []

    def visit(folder: Path, folders: Sequence[str], _: Sequence[str]) -> Sequence[str]:
        data_set = data_set_in(folder) if folder != place else _data_set_at(place, layout)
        if data_set is None:
            return folders
        if layout in {None, data_set.layout}:
            found.extend(_unit(base, data_set, each) for each in data_set.recordings)
        covered = _covered(folder, folders, data_set.recordings)
        return [name for name in folders if name not in covered]

    search.walk(place, visit)
    return found


def in_order(units: Iterable[WorkUnit], roots: Sequence[Path]) -> list[WorkUnit]:
    """Return units in the order of their names.

    Raises:
        UsageError: Two have one name.
    """
    ordered = sorted(units, key=lambda unit: unit.name)
    counts = Counter(unit.name for unit in ordered)
    repeated = [name for name, count in counts.items() if count > 1]
    if repeated:
        places = [unit.origin for unit in ordered if unit.name == repeated[0]]
        raise UsageError(
            f'{roots[0]}: several units have the name {some_of(repeated)}, such as'
            f' {some_of(places)}; choose among them with a glob or a list'
        )
    return ordered


def refuse_within(units: Iterable[WorkUnit], out: Path) -> None:
    """Refuse an output folder inside a unit; it may lie between the units of a root.

    Raises:
        UsageError: It lies inside.
    """
    target = out.resolve() if is_remote(out) else Path(real_place(out))
    around = {str(each) for each in (target, *target.parents)}
    for unit in units:
        for source in filter(None, (unit.source, unit.result)):
            if real_place(source) in around:
                refuse_inside(source, out)


def _unit(base: Path, data_set: DataSet, candidate: Candidate) -> WorkUnit:
    if candidate.folder is None:  # it shares its folders, and has a name in the data set
        folder = absolute(data_set.folder)
        place = Path(relative_place(folder, base), candidate.name)
        return WorkUnit(place.as_posix(), folder, data_set.layout, candidate.name)
    folder = absolute(candidate.folder)
    return WorkUnit(relative_name(folder, base), folder, data_set.layout)


def _data_set_at(root: Path, layout: Layout | None) -> DataSet | None:
    try:
        found = data_sets_at(root, ReadOptions(layout=layout))
    except PermissionError:  # of one of its recordings; the others are found in their folders
        return None
    return found[0] if found else None


def _covered(folder: Path, folders: Sequence[str], recordings: Iterable[Candidate]) -> set[str]:
    """Return the names of the folders in a folder that belong to recordings found there."""
    names = set()
    for each in recordings:
        if each.folder is None or each.folder == folder:
            return {name for name in folders if is_inside(name)}
        names.add(each.folder.relative_to(folder).parts[0])
    return names


def _slices(unit: WorkUnit, frames: int) -> Iterator[WorkUnit]:
    """Divide an object split into slices of so many present frames; keep other units whole."""
    if unit.layout is None or not unit.layout.traits.frame_set:
        yield unit
        return
    recording = open_recording(unit.source, unit.read, scans=False)
    present = [index.numbers for index in recording.streams.values()]
    numbers = np.unique(np.concatenate(present)).tolist()
    for start in range(0, len(numbers), frames):
        part = numbers[start : start + frames]
        name = f'{unit.name}/{part[0]:0{_FRAME_DIGITS}d}-{part[-1]:0{_FRAME_DIGITS}d}'
        yield replace(unit, name=name, first=part[0], last=part[-1])
