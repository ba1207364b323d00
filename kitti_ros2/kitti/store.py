# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Access to KITTI's files, on disk or in a store: listing, reading and writing."""

from __future__ import annotations

import os
import stat
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..files.local_files import start_writing_out, write_uncached
from ..files.remote import RemotePath
from ..model.errors import BadFileError, format_bytes
from .names import FileNames, find_frames, find_numbered, split_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from ..model.samples import Int64Array


# Listings of folders, read once while a recording is looked for and opened.

S = TypeVar('S')

_LISTINGS: ContextVar[dict[Path, list[str]] | None] = ContextVar('listings', default=None)


@contextmanager
def cached_listings() -> Iterator[None]:
    """List each folder once within this context, or within the outermost one.

    The detection of a layout asks for the names in a folder once for each layout, and the reader
    once more. What changes on the disk meanwhile is not noticed.
    """
    if _LISTINGS.get() is not None:
        yield
        return
    token = _LISTINGS.set({})
    try:
        yield
    finally:
        _LISTINGS.reset(token)


def cached_listing(names: Callable[[S, Path], list[str]]) -> Callable[[S, Path], list[str]]:
    """Wrap the method that lists a folder, for cached_listings."""

    @wraps(names)
    def listed(store: S, folder: Path) -> list[str]:
        listings = _LISTINGS.get()
        if listings is None:
            return names(store, folder)
        if folder not in listings:
            listings[folder] = names(store, folder)
        return listings[folder].copy()

    return listed


_CHUNK_BYTES = 1 << 20

MOST_BYTES = 256 << 20
"""Limit for a file that is read: a scan of KITTI has 2 MB, an image 1 MB."""


@dataclass(frozen=True, eq=False)
class Listing:
    """The numbered files of a folder.

    Attributes:
        folder: The folder that was listed.
        numbers: Their file numbers, ascending.
        names: How they are named.
        strays: Other names in the folder.
        doubles: By number the names of further files of a frame, which are not read.
    """

    folder: Path
    numbers: Int64Array
    names: FileNames
    strays: tuple[str, ...] = ()
    doubles: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    def path(self, number: int) -> Path:
        """Return the path of the file with a number."""
        return self.folder / self.names.name(number)

    def stem(self, number: int) -> str:
        """Return the name of a file without suffix: that of other files of the frame, too."""
        return split_name(self.names.name(number))[0]


@contextmanager
def _opened(path: Path) -> Iterator[tuple[int, int]]:
    """Open a regular file that fits into memory; yield its descriptor and its size."""
    # A file object costs as much as reading a small file; opening a pipe would wait.
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise BadFileError(path, 'is no regular file', 'a file')
        _check_size(path, status.st_size)
        yield file, status.st_size
    except OSError as error:
        error.filename = str(path)
        raise
    finally:
        os.close(file)


def _check_size(path: Path, size: int) -> None:
    if size > MOST_BYTES:
        size_text, most = map(format_bytes, (size, MOST_BYTES))
        raise BadFileError(path, f'{size_text}, which is not read', f'a file of at most {most}')


def _pread(file: int, length: int, position: int) -> bytes:
    """Read bytes of a file; fewer only where it ends."""
    data = b''
    while chunk := os.pread(file, length - len(data), position + len(data)):
        data += chunk
    return data


def decode_text(data: bytes, path: Path) -> str:
    """Decode the content of a text file.

    Raises:
        BadFileError: It is not UTF-8.
    """
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise BadFileError(path, f'byte {error.start} is no text', 'a text file in UTF-8') from None


def _remote_names(folder: RemotePath) -> list[str]:
    from ..files.remote_reads import listing_of  # noqa: PLC0415 - for URLs only

    try:
        return [*listing_of(folder)]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _read_remote(path: RemotePath) -> bytes:
    from ..files.remote_reads import AHEAD  # noqa: PLC0415 - for URLs only

    return AHEAD.read(path)


def _read_remote_ends(path: RemotePath, length: int) -> tuple[bytes, int]:
    from ..files.remote_reads import RemoteBytes  # noqa: PLC0415 - for URLs only

    source = RemoteBytes(path)
    head = source.read(0, length)
    start = max(source.size - length, len(head))
    return head + source.read(start, source.size - start), source.size


class FileStore:
    """Files on a local disk, or at URLs."""

    @cached_listing
    def names(self, folder: Path) -> list[str]:
        """List the names in a folder, sorted; none if the folder is absent."""
        if isinstance(folder, RemotePath):
            return _remote_names(folder)
        try:
            return sorted(os.listdir(folder))  # noqa: PTH208 - Path.iterdir is twice as slow
        except (FileNotFoundError, NotADirectoryError):
            return []

    def list_numbered(
        self,
        folder: Path,
        suffixes: tuple[str, ...],
        digits: int,
        frames: FileNames | None = None,
    ) -> Listing:
        """List the files of frames in a folder; see names.find_numbered."""
        numbered = find_numbered(self.names(folder), suffixes, digits, frames)
        numbers = np.array(numbered.numbers, dtype=np.int64)
        return Listing(folder, numbers, numbered.names, numbered.strays, numbered.doubles)

    def find_frames(self, folders: Mapping[Path, tuple[str, ...]], digits: int) -> FileNames:
        """Return how the frames in folders are named; see names.find_frames."""

        def listed() -> Iterator[tuple[list[str], tuple[str, ...]]]:
            for folder, suffixes in folders.items():
                with suppress(OSError):  # told where the folder is listed
                    yield self.names(folder), suffixes

        return find_frames(listed(), digits)

    def read(self, path: Path) -> bytes:
        """Read a whole file.

        Raises:
            BadFileError: It is a pipe or a device, which may have no end, or beyond MOST_BYTES.
            OSError: The file cannot be read.
        """
        if isinstance(path, RemotePath):
            return _read_remote(path)
        with _opened(path) as (file, size):
            chunks = [os.read(file, size + 1)]
            count = 0
            while chunks[-1]:
                count += len(chunks[-1])
                _check_size(path, count)
                chunks.append(os.read(file, _CHUNK_BYTES))
        return chunks[0] if len(chunks) == 2 else b''.join(chunks)

    def read_array(self, path: Path) -> npt.NDArray[np.uint8]:
        """Read a whole file into a writable array of its bytes; one that is growing up to now.

        Raises:
            BadFileError, OSError: As read.
        """
        if isinstance(path, RemotePath):
            return np.frombuffer(bytearray(_read_remote(path)), np.uint8)
        with _opened(path) as (file, size):
            data = np.empty(size, np.uint8)
            filled = 0
            while filled < size and (count := os.readv(file, [data.data[filled:]])):
                filled += count
        return data[:filled]

    def read_ends(self, path: Path, length: int) -> tuple[bytes, int]:
        """Read the first and the last bytes of a file, `length` each, and its size.

        Raises:
            BadFileError, OSError: As read.
        """
        if isinstance(path, RemotePath):
            return _read_remote_ends(path, length)
        with _opened(path) as (file, size):
            head = _pread(file, min(length, size), 0)
            start = max(size - length, len(head))
            return head + _pread(file, size - start, start), size

    def read_text(self, path: Path) -> str:
        """Read a whole text file, line ends unchanged.

        Raises:
            BadFileError: The content is not UTF-8, or it is no regular file.
            OSError: The file cannot be read.
        """
        return decode_text(self.read(path), path)

    def write(self, path: Path, data: bytes | memoryview, *, new: bool = False) -> None:
        """Write a whole file, and create its folders.

        Args:
            path: The file.
            data: Its content.
            new: Refuse to overwrite a file.

        Raises:
            FileExistsError: It exists, and new is set.
            OSError: It cannot be written.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open('xb' if new else 'wb', buffering=0) as file:
            view = memoryview(data).cast('B')
            position = 0
            while position < len(view):
                position += write_uncached(file.fileno(), [view[position:]], position)
            start_writing_out(file.fileno())

    def write_text(self, path: Path, text: str) -> None:
        """Write a whole text file, line ends unchanged."""
        self.write(path, text.encode())


STORE = FileStore()


# The text files of a whole recording: read for its index, and once more for its description.


class CommonFiles:
    """Files of a whole recording, each kept from the first reading until it is taken."""

    def __init__(self) -> None:
        self._known: dict[Path, bytes] = {}

    def read(self, path: Path) -> bytes:
        """Read a whole file and keep it.

        Raises:
            BadFileError, OSError: As STORE.read.
        """
        data = self._known.get(path)
        if data is None:
            data = self._known[path] = STORE.read(path)
        return data

    def read_text(self, path: Path) -> str:
        """Read a whole text file and keep it.

        Raises:
            BadFileError, OSError: As STORE.read_text.
        """
        return decode_text(self.read(path), path)

    def take_text(self, path: Path) -> str:
        """Read a whole text file; it is not kept any more.

        Raises:
            BadFileError, OSError: As STORE.read_text.
        """
        data = self._known.pop(path, None)
        return STORE.read_text(path) if data is None else decode_text(data, path)
