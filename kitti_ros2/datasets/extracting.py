# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Extracts KITTI's archives into the trees that readers expect."""

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


# A folder for one run at a time, removed if it stays empty.


@contextmanager
def locked_folder(path: Path) -> Iterator[None]:
    """Create a folder, and lock it against other runs.

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
    """Remove empty folders in the end, such as after a typing error."""
    try:
        yield
    finally:
        for folder in folders:
            with suppress(OSError):
                folder.rmdir()


# Complete files that are renamed together, once all are on the disk.

_MOST_FILES = 256
_MOST_BYTES = 256 * 2**20


class PendingFiles:
    """Complete files under temporary names.

    Syncing files one by one takes a hundred times as long as together.

    Args:
        root: The folder above them.
        fsync: True makes them outlast a power cut.
    """

    def __init__(self, root: Path, *, fsync: bool) -> None:
        self._root = root
        self._fsync = fsync
        self._parts: dict[Path, Path] = {}
        self._size_bytes = 0
        self._folders: set[Path] = set()

    def __contains__(self, target: Path) -> bool:
        """Return whether a file is not renamed yet."""
        return target in self._parts

    def add(self, part: Path, target: Path, size: int) -> None:
        """Add a complete file, to be renamed soon.

        Raises:
            OSError: The disk refuses; the file is not renamed.
        """
        self._parts[target] = part
        self._size_bytes += size
        most = _MOST_FILES if self._fsync else 1
        if len(self._parts) >= most or self._size_bytes >= _MOST_BYTES:
            self.publish()

    def note(self, target: Path) -> None:
        """Add a file that has its name, perhaps not on the disk yet."""
        self._folders.add(target.parent)

    def publish(self) -> None:
        """Rename all files.

        Raises:
            OSError: The disk refuses; the remaining files are not renamed.
        """
        if self._fsync:
            sync_files([*self._parts.values()])
        for target in [*self._parts]:
            self._parts[target].replace(target)
            self._folders.add(target.parent)
            del self._parts[target]
        self._size_bytes = 0

    def settle(self) -> None:
        """Rename all files, and sync the names to the disk.

        Raises:
            OSError: The disk refuses.
        """
        self.publish()
        if self._fsync:
            folders = {parent for folder in self._folders for parent in (folder, *folder.parents)}
            sync_folders(folder for folder in folders if self._root in (folder, *folder.parents))
        self._folders.clear()

    def drop(self) -> None:
        """Remove the files that are not renamed."""
        for part in self._parts.values():
            part.unlink(missing_ok=True)
        self._parts.clear()


# The folder of an extraction: nothing is written outside of it, or half.

_DIFFERS = 'exists with other content; pass --overwrite to replace it'
_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC


class Outcome(Enum):
    """The result of extracting a file."""

    WRITTEN = 'written'
    KEPT = 'kept'
    PREFERRED = 'preferred'
    """The existing file differs, and has more content."""


class Tree:
    """The folder of an extraction.

    Args:
        root: The folder; it exists.
        overwrite: True replaces existing files that differ.
        fsync: True makes settled files outlast a power cut.
    """

    def __init__(self, root: Path, *, overwrite: bool, fsync: bool = True) -> None:
        self._root = root
        self._pending = PendingFiles(root, fsync=fsync)
        self._real = Path(os.path.realpath(root))
        self._overwrite = overwrite
        self._folders: dict[Path, str] = {}

    def put(
        self, member: Member, name: str, chunks: Iterator[bytes], advance: Callable[[int], None]
    ) -> Outcome:
        """Write a file, unless it exists with the same content; settle renames it.

        Args:
            member: The file as the archive lists it.
            name: Path below the root.
            chunks: Content; read only if needed.
            advance: Called with the bytes of each chunk.

        Raises:
            BadMemberError: The content is damaged, or something else has the name.
            OSError: The disk refuses.
        """
        target = self._root / name
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
        """Rename all files, and sync them to the disk.

        Raises:
            OSError: The disk refuses.
        """
        self._pending.settle()

    def close(self) -> None:
        """Rename the complete files, and remove the others; never raises OSError."""
        with suppress(OSError):
            self._pending.publish()
        self._pending.drop()

    def _compare(self, target: Path, part: Path, size: int, crc: int) -> Outcome:
        """Decide between an existing file and a complete new one."""
        if _equals(target, size, crc):
            return Outcome.KEPT
        if _may_differ(target) and _has_scanner(target) != _has_scanner(part):
            return Outcome.PREFERRED if _has_scanner(target) else Outcome.WRITTEN
        if not self._overwrite:
            raise BadMemberError(_DIFFERS)
        return Outcome.WRITTEN

    def _enter(self, folder: Path) -> None:
        """Create a folder below the root, and check that no link leads elsewhere."""
        if folder == self._root:
            return
        if folder not in self._folders:
            self._enter(folder.parent)
            self._folders[folder] = self._open_folder(folder)
        if self._folders[folder]:
            raise BadMemberError(self._folders[folder])

    def _open_folder(self, folder: Path) -> str:
        """Create a folder; return the reason if it is unusable, else an empty text."""
        try:
            mode = folder.lstat().st_mode
        except FileNotFoundError:
            folder.mkdir()
            return ''
        if S_ISLNK(mode):
            real_path = Path(os.path.realpath(folder))
            inside = real_path.is_dir() and self._real in real_path.parents
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
            rest = memoryview(chunk)
            while rest:  # a full disk takes only a part
                rest = rest[file.write(rest) :]
            advance(len(chunk))
        start_writing_out(file.fileno())
    if written != member.size:
        raise BadMemberError(
            f'damaged: its content has {"more" if written > member.size else "less"} than the'
            f' {member.size:,} bytes that the archive declares'
        )
    return crc


def _equals(path: Path, size: int, crc: int) -> bool:
    """Return whether a file has a size and CRC-32."""
    if path.stat().st_size != size:
        return False
    actual_crc = 0
    with path.open('rb') as file:
        while chunk := file.read(CHUNK_BYTES):
            actual_crc = crc32(chunk, actual_crc)
    return actual_crc == crc


def _may_differ(path: Path) -> bool:
    """Return whether KITTI's own archives have different files of this name.

    calib.txt of odometry has no line of the scanner in the archives of images.
    """
    return path.name == names.ODOMETRY_CALIB


def _has_scanner(path: Path) -> bool:
    return b'\nTr' in b'\n' + path.read_bytes()[:CHUNK_BYTES]


# The choice of files to extract, and their target paths; nothing is written here.

_NOISE = frozenset({'__MACOSX', '.DS_Store', 'Thumbs.db', 'desktop.ini'})
_REPACKED = 'it was not packed by KITTI; extract it with another program'


@dataclass(frozen=True)
class ArchiveFiles:
    """The files of an archive to extract.

    Attributes:
        path: The archive.
        files: The files with their paths below the root, in the order of the archive.
        notes: Lines that cost no data.
    """

    path: Path
    files: tuple[tuple[Member, str], ...]
    notes: tuple[str, ...]

    @property
    def size_bytes(self) -> int:
        """Declared bytes of all files."""
        return sum(member.size for member, _ in self.files)


def list_files(path: Path, root: Path, limits: Limits) -> ArchiveFiles:
    """List the files of an archive with their paths below the root.

    Raises:
        BadArchiveError: The archive is damaged, hostile, or without KITTI's folders.
        MissingPathError: There is no such file.
        UsageError: The root is a part of a data set.
    """
    with open_archive(path) as packed:
        files = [member for member in checked(packed, limits) if not member.is_folder]
    data_files = [file for file in files if not _is_noise(file.name)]
    file_names = [file.name for file in data_files]
    kitti_names = [name for name in file_names if is_kitti(name, path.name)]
    if not kitti_names:
        what = f'contains no folder of KITTI in {format_count(len(file_names), "file")}'
        raise BadArchiveError(path, what, 'extract it with another program')
    targets = paths_below(root, target_paths(file_names, path.name))
    if is_part_of_set(Path(os.path.realpath(root)).name) and any(
        _is_whole(target) for target in targets
    ):
        raise UsageError(
            f'{root}: is a part of a data set, and {path} contains whole data sets;'
            f' give the folder above it'
        )
    member_targets = list(zip(data_files, targets, strict=True))
    _check_collisions(path, member_targets)
    skipped = len(files) - len(data_files)
    note = f'{path}: {format_count(skipped, "file")} of desktop programs left out, as .DS_Store'
    return ArchiveFiles(path, tuple(member_targets), (note,) if skipped else ())


def _is_noise(name: str) -> bool:
    parts = name.split('/')
    return not _NOISE.isdisjoint(parts) or parts[-1].startswith('._')


def _is_whole(target: str) -> bool:
    """Return whether a path begins with a folder above the parts of a data set."""
    return is_top(target.partition('/')[0])


def _check_collisions(path: Path, member_targets: Iterable[tuple[Member, str]]) -> None:
    """Refuse names that collide on some file systems, and files with files in them."""
    spellings: dict[str, str] = {}
    files: dict[str, Member] = {}
    folders: set[str] = set()
    for member, target in member_targets:
        parts = target.split('/')
        for depth in range(1, len(parts) + 1):
            part = '/'.join(parts[:depth])
            key = unicodedata.normalize('NFC', part).casefold()
            if spellings.setdefault(key, part) != part:
                what = f'contains both {spellings[key]!r} and {part!r}'
                raise BadArchiveError(path, what, _REPACKED)
        folders.update('/'.join(parts[:depth]) for depth in range(1, len(parts)))
        other = files.setdefault(target, member)
        if (other.size, other.crc) != (member.size, member.crc):
            raise BadArchiveError(path, f'contains two different files {target!r}', _REPACKED)
    both = folders & files.keys()
    if both:
        raise BadArchiveError(path, f'contains {min(both)!r} as a file and as a folder', _REPACKED)


if TYPE_CHECKING:
    AnyPath = str | PathLike[str]
    Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class ExtractedArchive:
    """The result of extracting an archive.

    Attributes:
        path: The archive.
        written: Number of files written.
        kept: Number of files that existed with the same content.
        size_bytes: Bytes written.
        removed: True if the archive was removed.
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
    """The result of an extraction.

    Attributes:
        root: The folder of the extraction.
        archives: Results of the readable archives.
        losses: Skipped archives and files.
        notes: Lines that cost no data.
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
        options: Options of `kitti-ros2 extract --help-all`, with underscores and the same defaults.

    Returns:
        Written, existing and skipped files.

    Raises:
        KittiRos2Error: The root or an option is invalid, the disk is full, or no archive can be
            used.

    Examples:
        >>> from kitti_ros2 import datasets
        >>> datasets.extract('2011_09_26_calib.zip', 'kitti')  # doctest: +SKIP
        ExtractReport(...)
    """
    archive_list = [archives] if isinstance(archives, (str, PathLike)) else archives
    paths = [Path(archive) for archive in archive_list]
    extract_options = make_extract_options(options)
    return extract_all(paths, Path(root), extract_options, progress or (lambda _done, _total: None))


def extract_all(
    archives: Sequence[Path], root: Path, options: ExtractOptions, progress: Progress
) -> ExtractReport:
    """Extract archives into a folder; see extract."""
    _check_arguments(archives, root)
    listings, losses = _list_all(archives, root, options)
    with locked_folder(root):
        _check_space(root, listings)
        extraction = _Extraction(
            root, options, sum(listing.size_bytes for listing in listings), progress
        )
        with closing(extraction):
            done = tuple(extraction.extract(listing) for listing in listings)
    notes = [note for listing in listings for note in listing.notes]
    return ExtractReport(root, done, (*losses, *extraction.losses), (*notes, *extraction.notes))


class _Extraction:
    """Writes the files of archives, and counts skipped ones."""

    def __init__(self, root: Path, options: ExtractOptions, total: int, progress: Progress) -> None:
        self._root = root
        self._options = options
        self._tree = Tree(root, overwrite=options.overwrite, fsync=options.fsync)
        self._total = total
        self._done = 0
        self._progress = progress
        self.losses: list[Loss] = []
        self.notes: list[str] = []

    def extract(self, listing: ArchiveFiles) -> ExtractedArchive:
        """Write the files of an archive, and remove it if requested."""
        skipped: defaultdict[str, list[str]] = defaultdict(list)
        counts = dict.fromkeys(Outcome, 0)
        size_bytes = 0
        readable = {member: target for member, target in listing.files if not member.locked}
        for member, target in listing.files:
            if member.locked:
                skipped[member.locked].append(target)
        with open_archive(listing.path) as packed:
            for member, chunks in packed.contents(readable):
                target = readable[member]
                try:
                    with stopping(self._root / target):
                        outcome = self._tree.put(member, target, chunks, self._advance)
                except BadMemberError as error:
                    skipped[str(error)].append(target)
                    continue
                counts[outcome] += 1
                size_bytes += member.size if outcome is Outcome.WRITTEN else 0
        with stopping(self._root):
            self._tree.settle()
        self.losses += [
            Loss(listing.path.name, len(of), f'{_first_of(of)}: {reason}')
            for reason, of in skipped.items()
        ]
        removed = self._options.remove_archives and not skipped
        if removed:
            listing.path.unlink()
        other = counts[Outcome.PREFERRED]
        if other:
            self.notes.append(
                f'{listing.path}: {format_count(other, "existing file")} named calib.txt kept,'
                f' as they have the scanner (Tr)'
            )
        written, kept = counts[Outcome.WRITTEN], counts[Outcome.KEPT]
        ends = listing.files[0][1], listing.files[-1][1]
        return ExtractedArchive(listing.path, written, kept, size_bytes, removed, ends)

    def close(self) -> None:
        """Keep complete files; never raises OSError."""
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


def _list_all(
    archives: Sequence[Path], root: Path, options: ExtractOptions
) -> tuple[list[ArchiveFiles], list[Loss]]:
    """List the files of all archives before anything is written.

    Raises:
        KittiRos2Error: None of them can be used.
    """
    limits = Limits(options.max_ratio, options.max_size)
    listings: list[ArchiveFiles] = []
    refused: list[tuple[Path, KittiRos2Error]] = []
    for path in dict.fromkeys(archives):
        try:
            listings.append(list_files(path, root, limits))
        except (BadArchiveError, MissingPathError) as error:
            refused.append((path, error))
    if not listings:
        raise refused[0][1]
    return listings, [Loss(path.name, 1, str(error)) for path, error in refused]


def _check_space(root: Path, listings: Iterable[ArchiveFiles]) -> None:
    """Check the free space for the missing files.

    Raises:
        OutputError: It is too small.
    """
    needed = sum(
        member.size
        for listing in listings
        for member, target in listing.files
        if not os.path.lexists(root / target)
    )
    require_space(root, needed, 'extract elsewhere')
