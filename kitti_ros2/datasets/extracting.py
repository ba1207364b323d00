# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives of KITTI, extracted into the trees that readers expect."""

from __future__ import annotations

import os
import unicodedata
from collections import defaultdict
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from os import PathLike
from pathlib import Path
from stat import S_ISDIR, S_ISLNK, S_ISREG
from typing import TYPE_CHECKING

from ..files.local_files import crc32, start_writing_out, sync_files, sync_folders
from ..files.local_staging import lock_exclusively, make_folder, output_error
from ..kitti import names
from ..kitti.archives import is_archive, is_kitti, is_part_of_set, is_top, paths_below, target_paths
from ..model.errors import KittiRos2Error, Loss, MissingPathError, UsageError, format_count
from ..options.datasets import make_extract_options
from .archive_formats import (
    CHUNK_BYTES,
    BadArchiveError,
    BadMemberError,
    Limits,
    checked,
    open_archive,
    stopping,
)
from .transfer import require_space

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from typing_extensions import Unpack

    from ..options.datasets import ExtractOptions
    from ..options.keywords import ExtractKeywords
    from .archive_formats import Member


# A folder that one run at a time writes to, and that does not stay if nothing was written.


@contextmanager
def locked_folder(path: Path) -> Iterator[None]:
    """Create a folder, and keep other runs out of it.

    Raises:
        OutputError: Another run is writing to it, or it cannot be created.
    """
    try:
        make_folder(path)
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise output_error(path, error) from error
    try:
        lock_exclusively(folder, path)
        yield
    finally:
        os.close(folder)


@contextmanager
def removed_if_empty(*folders: Path) -> Iterator[None]:
    """Remove folders in the end if nothing is in them, such as after a typing error."""
    try:
        yield
    finally:
        for folder in folders:
            with suppress(OSError):
                folder.rmdir()


# Complete files that get their names together, once all of them are on the disk.

_MOST_FILES = 256
_MOST_BYTES = 256 * 2**20


class PendingFiles:
    """Files that are complete under other names.

    To sync files one by one takes the disk a hundred times as long as to sync them together.

    Args:
        root: The folder that they are below.
        fsync: Whether they outlast a power cut.
    """

    def __init__(self, root: Path, *, fsync: bool) -> None:
        self._root = root
        self._fsync = fsync
        self._parts: dict[Path, Path] = {}
        self._size_bytes = 0
        self._folders: set[Path] = set()

    def __contains__(self, target: Path) -> bool:
        """Whether a file is waiting for its name."""
        return target in self._parts

    def add(self, part: Path, target: Path, size: int) -> None:
        """Let a complete file get its name soon.

        Raises:
            OSError: The disk refuses; the file that it is about has no name.
        """
        self._parts[target] = part
        self._size_bytes += size
        most = _MOST_FILES if self._fsync else 1
        if len(self._parts) >= most or self._size_bytes >= _MOST_BYTES:
            self.publish()

    def note(self, target: Path) -> None:
        """Note that a file has its name already, perhaps not on the disk yet."""
        self._folders.add(target.parent)

    def publish(self) -> None:
        """Give all files their names.

        Raises:
            OSError: The disk refuses; the files that are left have no name.
        """
        if self._fsync:
            sync_files([*self._parts.values()])
        for target in [*self._parts]:
            self._parts[target].replace(target)
            self._folders.add(target.parent)
            del self._parts[target]
        self._size_bytes = 0

    def settle(self) -> None:
        """Give all files their names, and wait until these are on the disk.

        Raises:
            OSError: The disk refuses.
        """
        self.publish()
        if self._fsync:
            folders = {parent for folder in self._folders for parent in (folder, *folder.parents)}
            sync_folders(folder for folder in folders if self._root in (folder, *folder.parents))
        self._folders.clear()

    def drop(self) -> None:
        """Remove the files that have no name."""
        for part in self._parts.values():
            part.unlink(missing_ok=True)
        self._parts.clear()


# A folder that files are extracted into: nothing is written outside of it, or half.

_DIFFERS = 'exists with other content; pass --overwrite to replace it'
_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC


class Outcome(Enum):
    """What was done with a file of an archive."""

    WRITTEN = 'written'
    KEPT = 'kept'
    PREFERRED = 'preferred'
    """The existing file differs, and has more in it."""


class Tree:
    """The folder that files are extracted into.

    Args:
        root: The folder; it exists.
        overwrite: Whether existing files that differ are replaced.
        fsync: Whether the files outlast a power cut, once settled.
    """

    def __init__(self, root: Path, *, overwrite: bool, fsync: bool = True) -> None:
        self._root = root
        self._pending = PendingFiles(root, fsync=fsync)
        self._real = Path(os.path.realpath(root))
        self._overwrite = overwrite
        self._folders: dict[Path, str] = {}

    def put(
        self, member: Member, place: str, chunks: Iterator[bytes], advance: Callable[[int], None]
    ) -> Outcome:
        """Write a file, unless it exists with the same content; settle gives it its name.

        Args:
            member: The file as the archive lists it.
            place: Where it goes below the root.
            chunks: Its content; read only if needed.
            advance: Called with the bytes of each chunk.

        Raises:
            BadMemberError: The content is damaged, or the place is taken.
            OSError: The disk refuses.
        """
        target = self._root / place
        self._enter(target.parent)
        if target in self._pending:
            self._pending.publish()
        exists = self._exists(target)
        if exists:
            self._pending.note(target)
        if exists and member.crc is not None and _equals(target, member.size, member.crc):
            advance(member.size)
            return Outcome.KEPT
        differs = exists and (member.crc is not None or target.stat().st_size != member.size)
        if differs and not self._overwrite and not _may_differ(target):
            raise BadMemberError(_DIFFERS)
        part = target.with_name(f'.{target.name}.part')
        try:
            crc = _write(part, member, chunks, advance)
            outcome = Outcome.WRITTEN
            if exists:
                outcome = self._compare(target, part, member.size, crc)
            if outcome is Outcome.WRITTEN:
                self._pending.add(part, target, member.size)
        finally:
            if target not in self._pending:
                part.unlink(missing_ok=True)
        return outcome

    def settle(self) -> None:
        """Wait until all files are on the disk, under their names.

        Raises:
            OSError: The disk refuses.
        """
        self._pending.settle()

    def close(self) -> None:
        """Give files that are complete their names, and remove the others; never raises OSError."""
        with suppress(OSError):
            self._pending.publish()
        self._pending.drop()

    def _compare(self, target: Path, part: Path, size: int, crc: int) -> Outcome:
        """Decide between an existing file and a new one, which is complete."""
        if _equals(target, size, crc):
            return Outcome.KEPT
        if _may_differ(target) and _has_scanner(target) != _has_scanner(part):
            return Outcome.PREFERRED if _has_scanner(target) else Outcome.WRITTEN
        if not self._overwrite:
            raise BadMemberError(_DIFFERS)
        return Outcome.WRITTEN

    def _enter(self, folder: Path) -> None:
        """Create a folder below the root, and check that it is not elsewhere."""
        if folder == self._root:
            return
        if folder not in self._folders:
            self._enter(folder.parent)
            self._folders[folder] = self._open_folder(folder)
        if self._folders[folder]:
            raise BadMemberError(self._folders[folder])

    def _open_folder(self, folder: Path) -> str:
        """Create a folder; return why it cannot be used, empty if it can."""
        try:
            mode = folder.lstat().st_mode
        except FileNotFoundError:
            folder.mkdir()
            return ''
        if S_ISLNK(mode):
            place = Path(os.path.realpath(folder))
            inside = place.is_dir() and self._real in place.parents
            return '' if inside else f'{folder} is a symbolic link that leads out of {self._root}'
        return '' if S_ISDIR(mode) else f'{folder} is a file, and a folder is needed there'

    def _exists(self, target: Path) -> bool:
        try:
            mode = target.lstat().st_mode
        except FileNotFoundError:
            return False
        if not S_ISREG(mode):
            kind = 'symbolic link' if S_ISLNK(mode) else 'folder' if S_ISDIR(mode) else 'device'
            raise BadMemberError(f'its place is taken by a {kind}; move it away')
        return True


def _write(
    part: Path, member: Member, chunks: Iterator[bytes], advance: Callable[[int], None]
) -> int:
    """Write the content of a member to a file and return its CRC-32."""
    crc = written = 0
    with open(os.open(part, _FLAGS, 0o666), 'wb', buffering=0) as file:  # noqa: PTH123
        for chunk in chunks:
            written += len(chunk)
            if written > member.size:
                break
            crc = crc32(chunk, crc)
            left = memoryview(chunk)
            while left:  # a disk that fills up takes less than it is given
                left = left[file.write(left) :]
            advance(len(chunk))
        start_writing_out(file.fileno())
    if written != member.size:
        raise BadMemberError(
            f'damaged: its content has {"more" if written > member.size else "less"} than the'
            f' {member.size:,} bytes that the archive declares'
        )
    return crc


def _equals(path: Path, size: int, crc: int) -> bool:
    """Whether a file has a size and CRC-32."""
    if path.stat().st_size != size:
        return False
    actual_crc = 0
    with path.open('rb') as file:
        while chunk := file.read(CHUNK_BYTES):
            actual_crc = crc32(chunk, actual_crc)
    return actual_crc == crc


def _may_differ(path: Path) -> bool:
    """Whether KITTI's own archives have different files of this name: calib.txt of odometry.

    The archives of images have it without the line of the scanner.
    """
    return path.name == names.ODOMETRY_CALIB


def _has_scanner(path: Path) -> bool:
    return b'\nTr' in b'\n' + path.read_bytes()[:CHUNK_BYTES]


# Which files of an archive are extracted, and to which places; nothing is written here.

_NOISE = frozenset({'__MACOSX', '.DS_Store', 'Thumbs.db', 'desktop.ini'})
_REPACKED = 'it was not packed by KITTI; extract it with another program'


@dataclass(frozen=True)
class Placement:
    """What is extracted of an archive.

    Attributes:
        path: The archive.
        files: Its files with their places below the root, in the order of the archive.
        notes: Non-fatal remarks.
    """

    path: Path
    files: tuple[tuple[Member, str], ...]
    notes: tuple[str, ...]

    @property
    def size_bytes(self) -> int:
        """Declared bytes of all files."""
        return sum(member.size for member, _ in self.files)


def place_files(path: Path, root: Path, limits: Limits) -> Placement:
    """List an archive and choose the place of each of its files.

    Raises:
        BadArchiveError: The archive is damaged or hostile, or contains nothing of KITTI's.
        MissingPathError: There is no such file.
        UsageError: The root is a part of a data set.
    """
    with open_archive(path) as packed:
        files = [member for member in checked(packed, limits) if not member.is_folder]
    chosen = [file for file in files if not _is_noise(file.name)]
    file_names = [file.name for file in chosen]
    kitti_names = [name for name in file_names if is_kitti(name, path.name)]
    if not kitti_names:
        what = f'contains no folder of KITTI in {format_count(len(file_names), "file")}'
        raise BadArchiveError(path, what, 'extract it with another program')
    wanted = paths_below(root, target_paths(file_names, path.name))
    if is_part_of_set(Path(os.path.realpath(root)).name) and any(
        _is_whole(place) for place in wanted
    ):
        raise UsageError(
            f'{root}: is a part of a data set, and {path} contains whole data sets;'
            f' give the folder above it'
        )
    placed = list(zip(chosen, wanted, strict=True))
    _check_collisions(path, placed)
    skipped = len(files) - len(chosen)
    note = f'{path}: {format_count(skipped, "file")} of desktop programs left out, as .DS_Store'
    return Placement(path, tuple(placed), (note,) if skipped else ())


def _is_noise(name: str) -> bool:
    parts = name.split('/')
    return not _NOISE.isdisjoint(parts) or parts[-1].startswith('._')


def _is_whole(place: str) -> bool:
    """Whether a place begins with a folder that belongs above a part of a data set."""
    return is_top(place.partition('/')[0])


def _check_collisions(path: Path, placed: Iterable[tuple[Member, str]]) -> None:
    """Refuse names that are the same file on some file systems, and files with files in them."""
    spellings: dict[str, str] = {}
    files: dict[str, Member] = {}
    folders: set[str] = set()
    for member, place in placed:
        parts = place.split('/')
        for depth in range(1, len(parts) + 1):
            part = '/'.join(parts[:depth])
            key = unicodedata.normalize('NFC', part).casefold()
            if spellings.setdefault(key, part) != part:
                what = f'contains both {spellings[key]!r} and {part!r}'
                raise BadArchiveError(path, what, _REPACKED)
        folders.update('/'.join(parts[:depth]) for depth in range(1, len(parts)))
        other = files.setdefault(place, member)
        if (other.size, other.crc) != (member.size, member.crc):
            raise BadArchiveError(path, f'contains two different files {place!r}', _REPACKED)
    both = folders & files.keys()
    if both:
        raise BadArchiveError(path, f'contains {min(both)!r} as a file and as a folder', _REPACKED)


if TYPE_CHECKING:
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
    paths = [Path(archive) for archive in given]
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
            root, options, sum(placement.size_bytes for placement in placements), progress
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
            for member, chunks in packed.contents(readable):
                place = readable[member]
                try:
                    with stopping(self._root / place):
                        outcome = self._tree.put(member, place, chunks, self._advance)
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
