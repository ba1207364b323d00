# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives of KITTI, extracted into the trees that readers expect."""

from __future__ import annotations

import os
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from ..kitti.archives import is_archive
from ..model.errors import KittiRos2Error, MissingPathError, UsageError
from ..model.losses import Loss
from ..model.text import format_count
from ..options.dataset_tables import make_extract_options
from .errors import BadArchiveError, BadMemberError, stopping
from .locking import locked_folder
from .members import Limits
from .open_archive import open_archive
from .placement import place_files
from .tree import Outcome, Tree
from .verification import require_space

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from typing_extensions import Unpack

    from ..options.fetching import ExtractOptions
    from .keywords import ExtractKeywords
    from .placement import Placement

    AnyPath = str | PathLike[str]
    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ExtractedArchive:
    """What was done with an archive.

    Attributes:
        path: The archive.
        written: Number of files written.
        kept: Number of files that existed with the same content.
        size_bytes: Bytes written.
        removed: Whether the archive was removed.
        ends: The first and the last of its files below the root.
    """

    path: Path
    written: int
    kept: int
    size_bytes: int
    removed: bool
    ends: tuple[str, str]


@dataclass(frozen=True)
class ExtractReport:
    """What was extracted.

    Attributes:
        root: The folder that was extracted into.
        archives: The archives that were read.
        losses: Archives and files that were skipped.
        notes: Non-fatal remarks.
    """

    root: Path
    archives: tuple[ExtractedArchive, ...]
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def extract(
    archives: AnyPath | Iterable[AnyPath],
    root: AnyPath,
    *,
    progress: Progress | None = None,
    **options: Unpack[ExtractKeywords],
) -> ExtractReport:
    """Extract archives of KITTI into a folder, as `kitti-ros2 extract` does.

    Args:
        archives: Zip or tar archives, as KITTI has them or repacked.
        root: The folder; it is created.
        progress: Called with the bytes done and the bytes of all.
        options: Those of `kitti-ros2 extract --help`, with underscores and the same defaults.

    Returns:
        What was written, kept and skipped.

    Raises:
        KittiRos2Error: The root or an option is invalid, the disk is full, or no archive can be
            used.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> datasets.extract('2011_09_26_calib.zip', 'kitti')  # doctest: +SKIP
        ExtractReport(...)
    """
    given = [archives] if isinstance(archives, (str, PathLike)) else archives
    paths = [Path(each) for each in given]
    chosen = make_extract_options(options)
    return extract_all(paths, Path(root), chosen, progress or (lambda _done, _total: None))


def extract_all(
    archives: Sequence[Path], root: Path, options: ExtractOptions, progress: Progress
) -> ExtractReport:
    """Extract archives into a folder; see extract."""
    _check_arguments(archives, root)
    placements, losses = _place_all(archives, root, options)
    with locked_folder(root):
        _check_space(root, placements)
        extraction = _Extraction(
            root, options, sum(each.size_bytes for each in placements), progress
        )
        with closing(extraction):
            done = tuple(extraction.extract(placement) for placement in placements)
    notes = [note for placement in placements for note in placement.notes]
    return ExtractReport(root, done, (*losses, *extraction.losses), (*notes, *extraction.notes))


class _Extraction:
    """The writing of the files of archives, with what was skipped so far."""

    def __init__(self, root: Path, options: ExtractOptions, total: int, progress: Progress) -> None:
        self._root = root
        self._options = options
        self._tree = Tree(root, overwrite=options.overwrite, fsync=options.fsync)
        self._total = total
        self._done = 0
        self._progress = progress
        self.losses: list[Loss] = []
        self.notes: list[str] = []

    def extract(self, placement: Placement) -> ExtractedArchive:
        """Write the files of an archive, and remove it if that was asked for."""
        skipped: defaultdict[str, list[str]] = defaultdict(list)
        counts = dict.fromkeys(Outcome, 0)
        size_bytes = 0
        readable = {member: place for member, place in placement.files if not member.locked}
        for member, place in placement.files:
            if member.locked:
                skipped[member.locked].append(place)
        with open_archive(placement.path) as packed:
            for member, pieces in packed.contents(readable):
                place = readable[member]
                try:
                    with stopping(self._root / place):
                        outcome = self._tree.put(member, place, pieces, self._advance)
                except BadMemberError as error:
                    skipped[str(error)].append(place)
                    continue
                counts[outcome] += 1
                size_bytes += member.size if outcome is Outcome.WRITTEN else 0
        with stopping(self._root):
            self._tree.settle()
        self.losses += [
            Loss(placement.path.name, len(of), f'{_first_of(of)}: {reason}')
            for reason, of in skipped.items()
        ]
        removed = self._options.remove_archives and not skipped
        if removed:
            placement.path.unlink()
        other = counts[Outcome.PREFERRED]
        if other:
            self.notes.append(
                f'{placement.path}: {format_count(other, "existing file")} named calib.txt kept,'
                f' as they have the scanner (Tr)'
            )
        written, kept = counts[Outcome.WRITTEN], counts[Outcome.KEPT]
        ends = placement.files[0][1], placement.files[-1][1]
        return ExtractedArchive(placement.path, written, kept, size_bytes, removed, ends)

    def close(self) -> None:
        """Keep what is complete; never raises OSError."""
        self._tree.close()

    def _advance(self, size: int) -> None:
        self._done += size
        self._progress(self._done, self._total)


def _first_of(places: Sequence[str]) -> str:
    return places[0] + (f' and {len(places) - 1} more' if len(places) > 1 else '')


def _check_arguments(archives: Sequence[Path], root: Path) -> None:
    if not archives:
        raise UsageError('no archive; expected at least one, then the folder to extract into')
    if root.is_file():
        what = 'is an archive; name the folder to extract into after the archives'
        raise UsageError(f'{root}: {what if is_archive(root.name) else "is a file, not a folder"}')
    for path in archives:
        if path.is_dir():
            raise UsageError(f'{path}: is a folder; give zip or tar archives, then the folder')


def _place_all(
    archives: Sequence[Path], root: Path, options: ExtractOptions
) -> tuple[list[Placement], list[Loss]]:
    """List all archives before anything is written.

    Raises:
        KittiRos2Error: None of them can be used.
    """
    limits = Limits(options.max_ratio, options.max_size)
    placements: list[Placement] = []
    refused: list[tuple[Path, KittiRos2Error]] = []
    for path in dict.fromkeys(archives):
        try:
            placements.append(place_files(path, root, limits))
        except (BadArchiveError, MissingPathError) as error:
            refused.append((path, error))
    if not placements:
        raise refused[0][1]
    return placements, [Loss(path.name, 1, str(error)) for path, error in refused]


def _check_space(root: Path, placements: Iterable[Placement]) -> None:
    """Check the free space for the files that do not exist.

    Raises:
        OutputError: It is too small.
    """
    needed = sum(
        member.size
        for placement in placements
        for member, place in placement.files
        if not os.path.lexists(root / place)
    )
    require_space(root, needed, 'extract elsewhere')
