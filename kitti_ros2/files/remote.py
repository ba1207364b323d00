# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Paths of files in object stores and on servers: s3://, gs://, http(s)://, memory:// and others.

fsspec reads and lists them. Credentials and endpoints are those that fsspec and its file systems
take from the environment and their own configuration files.
"""

from __future__ import annotations

import io
import os
import posixpath
import re
import stat
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any
from urllib.parse import unquote

from ..model.errors import BadFileError, UsageError, shown
from .url_path import URL, LocalPathError, UrlPath

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from typing_extensions import Self, TypeIs


_CHAIN = re.compile(r'[A-Za-z][\w+.-]*(?:://[^:]*)?::[A-Za-z][\w+.-]*(?:://|::)', re.ASCII)
_LOCAL = ('file', 'local')


class RemotePath(UrlPath):
    """A file or folder of a store; its text is its URL, such as s3://bucket/folder/name.

    What asks the disk in Path asks the store here, by one listing of each folder.
    """

    def stat(self, *, follow_symlinks: bool = True) -> os.stat_result:  # noqa: ARG002 - as in Path
        """Return type, size in bytes and time of change, 0 if the store has none.

        Raises:
            FileNotFoundError: There is nothing.
            OSError, RemoteError: The store cannot be asked.
        """
        from .remote_reads import sized_entry_of  # noqa: PLC0415 - for URLs only

        entry = sized_entry_of(self)
        mode = (stat.S_IFDIR | 0o555) if entry.is_folder else (stat.S_IFREG | 0o444)
        times: Any = dict.fromkeys(('st_atime_ns', 'st_mtime_ns', 'st_ctime_ns'), entry.changed_ns)
        seconds = entry.changed_ns // 10**9
        return os.stat_result((mode, 0, 0, 1, 0, 0, entry.size or 0, *(seconds,) * 3), times)

    def lstat(self) -> os.stat_result:
        """Return the same as stat."""
        return self.stat()

    def _is_folder(self) -> bool | None:
        """Return whether it is a folder; None if there is nothing."""
        from .remote_reads import entry_of  # noqa: PLC0415 - for URLs only

        try:
            return entry_of(self).is_folder
        except (FileNotFoundError, NotADirectoryError):
            return None

    def exists(self, *, follow_symlinks: bool = True) -> bool:  # noqa: ARG002 - as in Path
        """Return whether there is a file or a folder."""
        return self._is_folder() is not None

    def is_file(self, *, follow_symlinks: bool = True) -> bool:  # noqa: ARG002 - as in Path
        """Return whether there is a file."""
        return self._is_folder() is False

    def is_dir(self, *, follow_symlinks: bool = True) -> bool:  # noqa: ARG002 - as in Path
        """Return whether there is a folder."""
        return self._is_folder() is True

    def is_symlink(self) -> bool:
        """Return false."""
        return False

    def iterdir(self) -> Iterator[Self]:  # type: ignore[override]
        """Yield what is in the folder."""
        from .remote_reads import listing_of  # noqa: PLC0415 - for URLs only

        yield from (self / name for name in listing_of(self))

    def open(  # type: ignore[override]
        self,
        mode: str = 'r',
        buffering: int = -1,
        encoding: str | None = None,
        errors: str | None = None,
        newline: str | None = None,
    ) -> IO[Any]:
        """Open for reading.

        Raises:
            LocalPathError: It is to be written.
            OSError, RemoteError: It cannot be read.
        """
        from .remote_reads import RemoteFile  # noqa: PLC0415 - for URLs only

        if mode.replace('t', '') not in {'r', 'rb', 'br'}:
            raise LocalPathError(self)
        file: Any = RemoteFile(self)
        if 'b' in mode:
            return file if buffering == 0 else io.BufferedReader(file)
        return io.TextIOWrapper(io.BufferedReader(file), encoding or 'utf-8', errors, newline)

    def read_bytes(self) -> bytes:
        """Read the whole file.

        Raises:
            OSError, RemoteError: It cannot be read.
        """
        from .remote_requests import fetch  # noqa: PLC0415 - for URLs only

        return fetch(self)


def is_remote(path: object) -> TypeIs[RemotePath]:
    """Return whether a path is a URL."""
    return isinstance(path, RemotePath)


def as_path(text: str | os.PathLike[str]) -> Path:
    """Return the path of a text: a RemotePath for URLs other than file://, else a Path.

    A local folder named `s3:` is `./s3:/...`.

    Raises:
        UsageError: The URL contains a password, is a chain of URLs, or file:// with a host; or no
            file can have the name.
    """
    if isinstance(text, Path):
        return text
    name = os.fspath(text)
    _check_name(name)
    if _CHAIN.match(name):
        raise UsageError(f'{name.partition("::")[0]}::...: chained URLs are not supported')
    match = URL.fullmatch(name)
    if match is None:
        return Path(name)
    if match[1].lower() not in _LOCAL:
        return RemotePath(name)
    local = match[2].removeprefix('localhost')
    if not local.startswith('/'):
        raise UsageError(f'{name}: names no file of this machine; expected file:///FOLDER/NAME')
    _check_name(unquote(local))
    return Path(unquote(local))


def _check_name(text: str) -> None:
    """Check that the system can be asked for a path: files of options may contain any character."""
    try:
        valid = b'\0' not in os.fsencode(text)
    except UnicodeEncodeError:
        valid = False
    if not valid:
        raise UsageError(f'{shown(text)}: no file can have this name')


def canonical_path(path: Path) -> str:
    """Return a text that is the same for all paths of one file or folder: links are followed."""
    return path.resolve().whole if is_remote(path) else os.path.realpath(path)


def relative_path(path: Path, folder: Path) -> str:
    """Return the way from a folder to a path, with .. where it is not below; both are absolute."""
    if is_remote(path) and is_remote(folder):
        return posixpath.relpath(f'/{"/".join(path.names)}', f'/{"/".join(folder.names)}')
    return os.path.relpath(path, folder)


def common_folder(paths: Sequence[Path]) -> Path:
    """Return the folder that contains all of some absolute paths, or is the only one of them.

    Raises:
        ValueError: There is none.
    """
    if not any(map(is_remote, paths)):
        return Path(os.path.commonpath(paths))
    first = paths[0]
    for folder in (first, *first.parents):
        if all(path == folder or folder in path.parents for path in paths):
            return folder
    raise ValueError(f'{first} and {paths[-1]} are in no common folder')


# The marker of an output in a store whose upload was not completed, and its check by readers.


def marker_of(path: RemotePath) -> RemotePath:
    """Return the marker of an output of several files."""
    return path.with_name(f'.{path.name}.partial')


def refuse_incomplete(path: Path) -> None:
    """Refuse to read an output whose upload was not completed, or what is in one.

    Args:
        path: A file or folder; local ones are not asked for.

    Raises:
        BadFileError: There is a marker.
    """
    if not is_remote(path) or path.scheme in {'http', 'https'}:
        return
    for folder in (path, *path.parents):
        if not folder.parent.name:
            return
        marker = marker_of(folder)
        if _is_there(marker):
            raise BadFileError(
                folder,
                'its upload was not completed',
                f'a complete output, without {marker}',
                remedy='run the command that writes it again, or remove the marker to read what'
                ' is there',
            )


def _is_there(marker: RemotePath) -> bool:
    from .remote_requests import StoreError, object_at  # noqa: PLC0415 - for URLs only

    # A bucket that may be read but not listed answers 403 for what is absent.
    with suppress(StoreError):
        return object_at(marker) is not None
    return False
