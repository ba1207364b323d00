# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files and folders written to the disk itself, where a power cut does not reach them.

A file is on the disk after fsync of the file and, for its name, fsync of its folder (fsync(2)).
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections import deque
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..model.errors import naming
from .workers import ordered_map

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

_THREADS = 8
"""They wait for the disk, which writes the metadata of files that are synced at once together."""
_BATCH = 32
"""Files that a thread takes at a time."""
_ALONE = 4
"""Up to so many files, threads cost more than they save."""
_SYNC_FILE_RANGE_WRITE = 2  # include/uapi/linux/fs.h
_STEP_BYTES = 32 * 2**20
# Of file systems that cannot sync a folder, and of folders that may be written but not read.
_FOLDER_NOT_SYNCED = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EACCES)


def sync_file(path: Path) -> None:
    """Write a file to the disk, and wait until it is there.

    Raises:
        OSError: The disk refuses.
    """
    _sync(path, os.O_RDONLY | os.O_NOFOLLOW)


def replace_file(part: Path, target: Path, *, fsync: bool) -> None:
    """Give a complete file its name; with fsync the file is on the disk before, the name after.

    Raises:
        OSError: The disk refuses.
    """
    if fsync:
        sync_file(part)
    part.replace(target)
    if fsync:
        sync_folders([target.parent])


def sync_folders(folders: Iterable[Path]) -> None:
    """Write the names in folders to the disk, and wait until they are there.

    Raises:
        OSError: The disk refuses.
    """
    for folder in dict.fromkeys(folders):
        try:
            _sync(folder, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            if error.errno not in _FOLDER_NOT_SYNCED:
                raise
            os.sync()


def sync_files(paths: Collection[Path]) -> None:
    """Write files to the disk, and wait until all are there.

    Quickest where start_writing_out was called for each: fsync of one then writes the metadata of
    all. Not syncfs, which would wait for what other programs write as well.

    Raises:
        OSError: The disk refuses.
    """
    if len(paths) <= _ALONE:
        for path in paths:
            sync_file(path)
    else:
        deque(ordered_map(sync_file, paths, _THREADS, _BATCH), maxlen=0)


def sync_tree(top: Path) -> None:
    """Write a file, or a folder with all that is in it, to the disk; wait until it is there.

    Raises:
        OSError: The disk refuses.
    """
    if not top.is_dir():
        sync_file(top)
        return
    folders = [top]
    files = []
    for entry in _entries(top):
        if entry.is_dir(follow_symlinks=False):
            folders.append(Path(entry.path))
        elif entry.is_file(follow_symlinks=False):
            files.append(Path(entry.path))
    sync_files(files)
    sync_folders(reversed(folders))


def start_writing_out(file: int, position: int = 0, size: int = 0) -> None:
    """Let the system begin to write a part of a file to the disk, without waiting for it.

    This guarantees nothing, but shortens a later fsync; it does nothing outside of Linux. Source:
    sync_file_range(2).

    Args:
        file: Descriptor of a regular file.
        position: Of the first byte.
        size: Number of bytes; 0: up to the end.
    """
    function = _sync_file_range()
    if function is not None:
        # Errors are those of the disk, which fsync reports.
        function(file, ctypes.c_int64(position), ctypes.c_int64(size), _SYNC_FILE_RANGE_WRITE)


class WritingOut:
    """A growing file that is written to the disk in steps, so that a last fsync has little to do.

    Args:
        path: The file; it exists, and is written by others.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        self._size = 0

    def advance(self, size: int) -> None:
        """Note that about so many bytes were written."""
        self._size += size
        if self._size >= _STEP_BYTES:
            self._size = 0
            start_writing_out(self._file)

    def close(self) -> None:
        """Stop watching the file; does nothing the second time."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)


def _sync(path: Path, flags: int) -> None:
    with naming(path):
        file = os.open(path, flags | os.O_CLOEXEC)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def _entries(folder: Path | str) -> Iterator[os.DirEntry[str]]:
    """Yield all entries below a folder, folders before what is in them."""
    with os.scandir(folder) as found:
        entries = [*found]
    for entry in entries:
        yield entry
        if entry.is_dir(follow_symlinks=False):
            yield from _entries(entry.path)


@lru_cache(maxsize=1)
def _sync_file_range() -> Any:  # noqa: ANN401 - a foreign function, or None
    return getattr(ctypes.CDLL(None, use_errno=True), 'sync_file_range', None)
