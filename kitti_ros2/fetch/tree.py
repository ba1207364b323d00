# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A folder that files are extracted into: nothing is written outside of it, or half."""

from __future__ import annotations

import os
from contextlib import suppress
from enum import Enum
from pathlib import Path
from stat import S_ISDIR, S_ISLNK, S_ISREG
from typing import TYPE_CHECKING

from ..files.checksums import crc32
from ..files.durability import start_writing_out
from ..kitti import names
from .errors import BadMemberError
from .members import PIECE_BYTES
from .pending import PendingFiles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .members import Member

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
        self, member: Member, place: str, pieces: Iterator[bytes], advance: Callable[[int], None]
    ) -> Outcome:
        """Write a file, unless it exists with the same content; settle gives it its name.

        Args:
            member: The file as the archive lists it.
            place: Where it goes below the root.
            pieces: Its content; read only if needed.
            advance: Called with the bytes of each piece.

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
            crc = _write(part, member, pieces, advance)
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
    part: Path, member: Member, pieces: Iterator[bytes], advance: Callable[[int], None]
) -> int:
    """Write the content of a member to a file and return its CRC-32."""
    crc = written = 0
    with open(os.open(part, _FLAGS, 0o666), 'wb', buffering=0) as file:  # noqa: PTH123
        for piece in pieces:
            written += len(piece)
            if written > member.size:
                break
            crc = crc32(piece, crc)
            left = memoryview(piece)
            while left:  # a disk that fills up takes less than it is given
                left = left[file.write(left) :]
            advance(len(piece))
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
    found = 0
    with path.open('rb') as file:
        while piece := file.read(PIECE_BYTES):
            found = crc32(piece, found)
    return found == crc


def _may_differ(path: Path) -> bool:
    """Whether KITTI's own archives have different files of this name: calib.txt of odometry.

    The archives of images have it without the line of the scanner.
    """
    return path.name == names.ODOMETRY_CALIB


def _has_scanner(path: Path) -> bool:
    return b'\nTr' in b'\n' + path.read_bytes()[:PIECE_BYTES]
