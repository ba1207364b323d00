# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Divides a data set into lists of frames or sequences, and checks such lists."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..files.remote import as_path
from ..files.staging import Staging, refuse_link, reported
from ..kitti import names as kitti_names
from ..kitti.image_set import format_image_set
from ..kitti.store import STORE
from ..model.errors import UsageError
from ..model.text import format_count
from .comparing import compare_lists
from .dividing import divide
from .given_lists import read_lists
from .units import Unit, find_units

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike
    from pathlib import Path

    from typing_extensions import Unpack

    from ..api.keywords import SplitKeywords
    from ..model.layouts import Layout
    from ..model.losses import Loss
    from ..options.split import SplitOptions
    from .comparing import ListPair
    from .units import UnitSet

    AnyPath = str | PathLike[str]


@dataclass(frozen=True)
class SplitList:
    """One list.

    Attributes:
        name: Such as train.
        path: Its file.
        entries: The frames, sequences or drives, in the order of the file.
        frames: Number of frames.
        share: The part of the frames of the set, 0 to 1; None of testing frames that are absent.
        drives: Number of raw drives, None if they are not known.
    """

    name: str
    path: Path
    entries: tuple[str, ...]
    frames: int
    share: float | None
    drives: int | None = None


@dataclass(frozen=True)
class SplitReport:
    """The lists that were written, or checked.

    Attributes:
        path: The folder of the lists.
        layout: The layout of the set.
        noun: What an entry is: frame, sequence or drive.
        lists: In order of writing; checked ones by name.
        pairs: Each list with each.
        unlisted: What is in no list.
        faults: Overlaps; when lists are checked also entries of one drive on both sides.
        losses: Missing data, and lines that could not be used.
        notes: Remarks.
    """

    path: Path
    layout: str
    noun: str
    lists: tuple[SplitList, ...]
    pairs: tuple[ListPair, ...]
    unlisted: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def split(src: AnyPath, **options: Unpack[SplitKeywords]) -> SplitReport:
    """Divide a data set into lists, as `kitti-ros2 split` does.

    Args:
        src: An object, tracking, odometry or raw data set.
        options: Those of `kitti-ros2 split --help`, with underscores and the same defaults:
            ratio=(0.8, 0.2), names=['train', 'val'], seed=1, by_drive=True, lists=[...],
            check=True, mapping=..., out=..., overwrite=True, layout=...

    Returns:
        The lists, what each two of them share, losses, notes. Each loss is also a
        KittiRos2Warning.

    Raises:
        KittiRos2Error: The set, an option or a list is invalid; nothing is left behind.

    Examples:
        >>> from kitti_ros2.datasets import split
        >>> report = split('object', ratio=(0.8, 0.2), out='lists')
        >>> [len(each.entries) for each in report.lists]
        [..., ...]
    """
    from ..api.keywords import by_name  # noqa: PLC0415 - for the library only
    from ..api.source import warn  # noqa: PLC0415 - pictures
    from ..options.dataset_tables import SPLIT, make_split_options  # noqa: PLC0415 - as above

    report = split_set(as_path(src), *make_split_options(by_name(options, SPLIT)))
    for loss in report.losses:
        warn(loss.text())
    return report


def split_set(path: Path, options: SplitOptions, layout: Layout | None = None) -> SplitReport:
    """Divide a data set, or check its lists.

    Raises:
        KittiRos2Error: The set, an option or a list is invalid; nothing is left behind.
        OSError: A file cannot be read.
    """
    found = find_units(path, layout, options.mapping, by_drive=options.by_drive)
    if options.out is not None:
        refuse_link(options.out)
    folder = options.out or found.folder / kitti_names.IMAGE_SETS
    if not (options.lists or options.check):
        return _divided(path, found, folder, options)
    checked = options.check
    given = read_lists(options.lists or _existing(folder), found)
    entries = {each.name: each.entries for each in given}
    paths = {each.name: each.path for each in given}
    if not checked:
        for each in given:
            each.require_entries()
        paths = _write(folder, entries, overwrite=options.overwrite)
    report = _report(found, folder, paths, entries, checked=checked)
    losses = [loss for each in given for loss in each.losses(checked=checked)]
    notes = [note for each in given for note in each.notes(checked=checked)]
    return replace(report, losses=(*report.losses, *losses), notes=(*report.notes, *notes))


def _divided(path: Path, found: UnitSet, folder: Path, options: SplitOptions) -> SplitReport:
    """Make random lists."""
    reserved = [name for name in options.list_names if found.is_of_testing(name)]
    if reserved:
        raise UsageError(
            f'{reserved[0]} names a list of the testing frames; choose another name,'
            f' such as holdout, or give {found.folder / kitti_names.SPLITS[1]}'
        )
    whole = options.by_drive or not found.lists_frames
    groups: dict[str, list[Unit]] = {}
    for unit in found.units.values():
        groups.setdefault((whole and unit.drive) or unit.name, []).append(unit)
    sizes = {name: sum(unit.frames for unit in units) for name, units in groups.items()}
    divided = divide(sizes, options.shares, options.seed or 0)
    if divided is None:
        noun = 'drive' if options.by_drive else found.noun
        lists = format_count(len(options.shares), 'list')
        raise UsageError(f'{path}: {format_count(len(sizes), noun)}, too few for {lists}')
    entries = {
        name: sorted(unit.name for group in members for unit in groups[group])
        for name, members in zip(options.list_names, divided, strict=True)
    }
    paths = _write(folder, entries, overwrite=options.overwrite)
    return _report(found, folder, paths, entries, checked=False)


def _existing(folder: Path) -> list[Path]:
    """Return the lists in a folder.

    Raises:
        UsageError: There is none.
    """
    files = [folder / name for name in STORE.names(folder) if name.endswith(kitti_names.TXT)]
    if not files:
        raise UsageError(f'{folder}: no lists to check; give their files with --lists')
    return files


def _write(folder: Path, lists: Mapping[str, Sequence[str]], *, overwrite: bool) -> dict[str, Path]:
    """Write lists, all or none, and return their files.

    Raises:
        OutputExistsError: A file exists and may not be replaced.
        OutputError: One cannot be written.
    """
    paths = {name: folder / f'{name}{kitti_names.TXT}' for name in lists}

    def refusal(path: Path) -> str | None:
        if path.is_dir():
            return 'it is a folder; choose another with --out'
        return None if overwrite else 'pass --overwrite, or choose another folder with --out'

    with ExitStack() as stack:
        stagings: list[Staging] = []
        for path in paths.values():
            stagings.append(Staging(path, refusal))
            stack.callback(stagings[-1].discard)
        for staging, entries in zip(stagings, lists.values(), strict=True):
            with reported(staging.path):
                staging.content.write_bytes(format_image_set(entries).encode())
        for staging in stagings:
            staging.publish()
    return paths


def _report(
    found: UnitSet,
    folder: Path,
    paths: Mapping[str, Path],
    lists: Mapping[str, Sequence[str]],
    *,
    checked: bool,
) -> SplitReport:
    """Describe lists, and compare those of the same frames."""
    of_testing = {name: each for name, each in lists.items() if found.is_of_testing(name)}
    others = {name: each for name, each in lists.items() if name not in of_testing}
    pairs = (*compare_lists(others, found.units), *compare_lists(of_testing, found.testing or {}))
    faults = [line for pair in pairs for line in pair.faults]
    leaks = [line for pair in pairs for line in pair.leaks]
    listed = {name for entries in others.values() for name in entries}
    return SplitReport(
        path=folder,
        layout=found.layout.value,
        noun=found.noun,
        lists=tuple(_describe(found, name, paths[name], lists[name]) for name in lists),
        pairs=pairs,
        unlisted=tuple(name for name in found.units if name not in listed) if others else (),
        faults=(*faults, *leaks) if checked else tuple(faults),
        losses=found.losses,
        notes=found.notes if checked else (*found.notes, *leaks),
    )


def _describe(found: UnitSet, name: str, path: Path, entries: Sequence[str]) -> SplitList:
    units = found.testing if found.is_of_testing(name) else found.units
    known = [Unit(entry) if units is None else units[entry] for entry in entries]
    frames = sum(unit.frames for unit in known)
    drives = {unit.drive for unit in known}
    total = 0 if units is None else sum(unit.frames for unit in units.values())
    return SplitList(
        name=name,
        path=path,
        entries=tuple(entries),
        frames=frames,
        share=frames / total if total else None,
        drives=None if None in drives or not drives else len(drives),
    )
