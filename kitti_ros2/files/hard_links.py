# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files of one folder tree placed in another: hard-linked, or copied where that is impossible."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.errors import BadFileError, UnreadableFileError
from .durability import start_writing_out

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from io import FileIO

_NO_LINKS = {
    errno.EXDEV: 'they are on another file system',
    errno.EPERM: 'the system does not permit hard links of these files',
    errno.EACCES: 'the system does not permit hard links of these files',
    errno.EMLINK: 'the file system permits no more hard links of them',
    errno.EOPNOTSUPP: 'the file system has no hard links',
    errno.ENOSYS: 'the file system has no hard links',
}
_BUFFER_BYTES = 1 << 20


class FilePlacer:
    """Places files by hard links or copies, from several threads.

    Attributes:
        copy: Whether files are copied; set by the first one that cannot be linked.
        why: Why that one cannot be linked, else ''.
    """

    def __init__(self, *, copy: bool) -> None:
        self.copy = copy
        self.why = ''

    def place(self, source: Path, target: Path) -> bool:
        """Place a file, whose folder is created; return whether it is a hard link.

        Raises:
            BadFileError: The source is a pipe or a device.
            UnreadableFileError: The source cannot be read.
            OSError: The target cannot be written.
        """
        try:
            # A hard link to a symbolic link would be one itself.
            real = Path(os.path.realpath(source)) if source.is_symlink() else source
            mode = real.stat().st_mode
        except OSError as error:
            raise UnreadableFileError(source, error) from None
        if not stat.S_ISREG(mode):
            raise BadFileError(source, 'is no regular file', 'a file')
        target.parent.mkdir(parents=True, exist_ok=True)
        if not self.copy:
            try:
                os.link(real, target)
            except OSError as error:
                if error.errno not in _NO_LINKS:
                    raise
                self.copy, self.why = True, _NO_LINKS[error.errno]
            else:
                return True
        _copy(source, target)
        return False


def _copy(source: Path, target: Path) -> None:
    """Copy the bytes that a file has now: some files of the system have no end."""
    try:
        file = source.open('rb', buffering=0)
        rest = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise UnreadableFileError(source, error) from None
    with file, target.open('xb') as copied:
        try:
            while rest and (piece := _read(file, min(rest, _BUFFER_BYTES), source)):
                copied.write(piece)
                rest -= len(piece)
            copied.flush()
            start_writing_out(copied.fileno())
        except UnreadableFileError:
            target.unlink()
            raise


def _read(file: FileIO, length: int, source: Path) -> bytes | None:
    try:
        return file.read(length)
    except OSError as error:
        raise UnreadableFileError(source, error) from None


def walk_files(
    top: Path, is_left_out: Callable[[Path], bool], failed: Callable[[OSError], None]
) -> Iterator[Path]:
    """Yield the files below a folder, or the file itself, sorted; symbolic links are followed.

    Args:
        top: A file or folder.
        is_left_out: Called with each file and folder. Hidden ones are left out as well.
        failed: Called with the error of a folder that cannot be listed.
    """
    if not top.is_dir():
        yield top
        return
    pending, seen = [top], set()
    while pending:
        folder = pending.pop()
        try:
            status = folder.stat()
            entries = sorted(folder.iterdir())
        except OSError as error:
            failed(error)
            continue
        if (status.st_dev, status.st_ino) in seen:  # links may lead back
            continue
        seen.add((status.st_dev, status.st_ino))
        for entry in entries:
            if entry.name.startswith('.') or is_left_out(entry):
                continue
            if entry.is_dir():
                pending.append(entry)
            else:
                yield entry
