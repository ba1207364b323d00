# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Local files: written to the disk itself, past the page cache, or as hard links; checksums."""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import re
import stat
import sys
from collections import deque
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ..model.errors import BadFileError, UnreadableFileError, naming
from .threads import ordered_map

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
    from io import FileIO


# The checksums of zlib, many times faster where isal is installed.

try:
    from isal.isal_zlib import adler32, crc32
except ImportError:  # a workspace may do without
    from zlib import adler32, crc32

__all__ = ['adler32', 'crc32']


# Files and folders written to the disk itself, where a power cut does not reach them.
#
# A file is on the disk after fsync of the file and, for its name, fsync of its folder (fsync(2)).

_THREADS = 8
"""Threads that wait for the disk, which writes the metadata of several files together."""
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
        position: Offset of the first byte.
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
    with os.scandir(folder) as scan:
        entries = [*scan]
    for entry in entries:
        yield entry
        if entry.is_dir(follow_symlinks=False):
            yield from _entries(entry.path)


@lru_cache(maxsize=1)
def _sync_file_range() -> Any:  # noqa: ANN401 - a foreign function, or None
    return getattr(ctypes.CDLL(None, use_errno=True), 'sync_file_range', None)


# Writes that do not fill the page cache.
#
# A drive that stays in the cache evicts other files from memory, and on many machines allocating
# pages costs more than writing does. Linux 6.16 on ext4, XFS and Btrfs starts writeback at once and
# drops the pages when they are on the disk; other systems keep the pages, and older Linux starts
# writeback at once all the same, so that a later fsync has little to do. Source: pwritev2(2),
# RWF_DONTCACHE; 6.14 supports the flag, but could drop pages that were still in use.

if TYPE_CHECKING:
    Buffers: TypeAlias = Sequence[bytes | bytearray | memoryview]

_RWF_DONTCACHE = 0x80  # include/uapi/linux/fs.h; missing in the module os
_SOUND_SINCE = (6, 16)
_UNKNOWN_FLAG = {errno.EOPNOTSUPP, errno.EINVAL}
_UNCACHED_FROM = 64 * 2**10
"""Below this size in bytes, a separate write to the disk costs more than the page."""


def write_uncached(file: int, buffers: Buffers, position: int) -> int:
    """Write all or part of the buffers at a position; large ones without filling the page cache.

    A last page that is not full is left to the next call: once dropped, it would have to be read
    again to be filled up.

    Args:
        file: Descriptor of a regular file.
        buffers: Flat bytes, at most IOV_MAX of them.
        position: Offset of the first byte in the file.

    Returns:
        Number of bytes written, as os.pwritev.

    Raises:
        OSError: The disk refuses.
    """
    size = sum(map(len, buffers))
    if size < _UNCACHED_FROM:
        return os.pwritev(file, buffers, position)
    if not _KERNEL_DROPS_PAGES:
        return _write_cached(file, buffers, position)
    pages = without_end(buffers, (position + size) % mmap.PAGESIZE)
    try:
        return os.pwritev(file, pages, position, _RWF_DONTCACHE)
    except NotImplementedError:
        pass  # a Python built for an old glibc supports no flags
    except OSError as error:
        if error.errno not in _UNKNOWN_FLAG:
            raise
    return _write_cached(file, buffers, position)


def _write_cached(file: int, buffers: Buffers, position: int) -> int:
    written = os.pwritev(file, buffers, position)
    start_writing_out(file, position, written)
    return written


def kernel_drops_pages(platform: str, release: str) -> bool:
    """Return whether a kernel (sys.platform, os.uname().release) handles the flag correctly."""
    version = re.match(r'(\d+)\.(\d+)', release, re.ASCII)
    if platform != 'linux' or version is None:
        return False
    return (int(version[1]), int(version[2])) >= _SOUND_SINCE


_KERNEL_DROPS_PAGES = kernel_drops_pages(sys.platform, os.uname().release)


def without_start(buffers: Buffers, count: int) -> Buffers:
    """Return the buffers without their first `count` bytes."""
    for index, buffer in enumerate(buffers):
        if count < len(buffer):
            return [memoryview(buffer)[count:], *buffers[index + 1 :]]
        count -= len(buffer)
    return []


def without_end(buffers: Buffers, count: int) -> Buffers:
    """Return the buffers without their last `count` bytes."""
    if not count:
        return buffers
    for index, buffer in reversed(list(enumerate(buffers))):
        if count < len(buffer):
            return [*buffers[:index], memoryview(buffer)[: len(buffer) - count]]
        count -= len(buffer)
    return []


# An unbuffered file that passes lists of buffers to the kernel without a copy.

_MAX_BUFFERS = min(os.sysconf('SC_IOV_MAX'), 1024)


class UnbufferedFile:
    """A new file, written from start to end.

    Attributes:
        position: Bytes written so far.

    Raises:
        OSError: The file exists or cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self.position = 0

    def write(self, buffers: Buffers) -> None:
        """Append all buffers (flat bytes) in order.

        Raises:
            OSError: The disk refuses; part of the buffers may have been written.
            ValueError: A buffer is not flat bytes.
        """
        for start in range(0, len(buffers), _MAX_BUFFERS):
            self._write_batch(buffers[start : start + _MAX_BUFFERS])

    def write_at(self, position: int, data: bytes) -> None:
        """Overwrite bytes that were written before.

        Raises:
            OSError: The disk refuses.
        """
        while data:
            written = os.pwrite(self._fd, data, position)
            position += written
            data = data[written:]

    def close(self) -> None:
        """Close the file; does nothing if it is closed.

        Raises:
            OSError: The file system reports a write that failed late.
        """
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _write_batch(self, buffers: Buffers) -> None:
        remaining = sum(map(len, buffers))
        while remaining > 0:
            written = write_uncached(self._fd, buffers, self.position)
            self.position += written
            remaining -= written
            if remaining > 0:
                # All but the last page; at most 2 GiB - 4 KiB; less where the disk fills up.
                buffers = without_start(buffers, written)
        if remaining:
            raise ValueError("a message part is no flat buffer of bytes (memoryview format 'B')")


# Hard links to files of another folder tree, or copies where links are impossible.

_NO_LINKS = {
    errno.EXDEV: 'they are on another file system',
    errno.EPERM: 'the system does not permit hard links of these files',
    errno.EACCES: 'the system does not permit hard links of these files',
    errno.EMLINK: 'the file system permits no more hard links of them',
    errno.EOPNOTSUPP: 'the file system has no hard links',
    errno.ENOSYS: 'the file system has no hard links',
}
_BUFFER_BYTES = 1 << 20


class FileLinker:
    """Links or copies files, from several threads.

    Attributes:
        copy: Whether files are copied; set by the first one that cannot be linked.
        why: Why that one cannot be linked, else ''.
    """

    def __init__(self, *, copy: bool) -> None:
        self.copy = copy
        self.why = ''

    def link(self, source: Path, target: Path) -> bool:
        """Link or copy a file into a new or existing folder; return whether it is a hard link.

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
            while rest and (block := _read(file, min(rest, _BUFFER_BYTES), source)):
                copied.write(block)
                rest -= len(block)
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
