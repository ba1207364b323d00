# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Fingerprints of a unit's input: the names, sizes and times of change of its files.

Of files in stores also their ETags. All come from the listings of the folders; those of web servers
have names only.
"""

from __future__ import annotations

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..files.remote import is_remote, relative_place
from ..kitti.listings import listings_kept
from ..kitti.names import number_of
from ..kitti.source_parts import parts_of
from ..model.errors import KittiRos2Error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from ..files.remote import RemotePath
    from ..files.remote_listing import RemoteEntry
    from ..model.layouts import Layout
    from .units import WorkUnit

_SHARED_MEMORY = '.db3-shm'  # that readers of SQLite make


class InputFile(NamedTuple):
    """A file of a unit.

    Attributes:
        name: Path below the unit's folder.
        size: Bytes; -1 if a store does not list them.
        mtime_ns: Time of the last change.
        tag: A store's ETag; empty if there is none.
    """

    name: str
    size: int
    mtime_ns: int
    tag: str = ''

    @property
    def number(self) -> int | None:
        """The number in its name, if that is a frame's."""
        return number_of(Path(self.name).stem)


def fingerprint(unit: WorkUnit) -> str:
    """Return the fingerprint of a unit's files; of a slice those of its frames and common files.

    A file that does not exist has no part in it.

    Raises:
        OSError: A folder cannot be read.
    """
    files: Iterable[InputFile]
    if unit.layout is None:
        files = _walk(unit.source, unit.source.parent)
    else:
        files = _files_of(unit.source, unit.layout, unit.sequence)
    if unit.result is not None:
        files = [*files, *_walk(unit.result, unit.result.parent)]
    if unit.first is not None and unit.last is not None:
        first, last = unit.first, unit.last
        files = (each for each in files if each.number is None or first <= each.number <= last)
    return _digest(files)


def fingerprint_paths(paths: Iterable[Path]) -> str:
    """Return the fingerprint of files and folders that options name.

    Raises:
        OSError: A folder cannot be read.
    """
    return _digest(each for path in paths for each in _walk(path, path.parent))


def _digest(files: Iterable[InputFile]) -> str:
    digest = hashlib.sha256()
    for each in sorted(files):
        tag = f'\0{each.tag}' if each.tag else ''
        text = f'{each.name}\0{each.size}\0{each.mtime_ns}{tag}\n'
        digest.update(text.encode(errors='replace'))
    return digest.hexdigest()


@lru_cache(maxsize=1)  # slices of one set follow each other
@listings_kept()
def _files_of(source: Path, layout: Layout, sequence: str | None) -> tuple[InputFile, ...]:
    try:
        parts = parts_of(source, layout, sequence)
    except KittiRos2Error:
        parts = [source]  # its unit will fail with this error, until something there changes
    return tuple(sorted({each for part in parts for each in _walk(part, source)}))


def _walk(path: Path, base: Path) -> Iterator[InputFile]:
    """Yield the files at a path; those that disappear meanwhile are left out."""
    if is_remote(path):
        yield from _walk_store(path, relative_place(path, base))
        return
    if not path.is_dir():
        if path.is_file():
            status = path.stat()
            yield InputFile(os.path.relpath(path, base), status.st_size, status.st_mtime_ns)
        return
    prefix = os.path.relpath(path, base)
    folders = [(str(path), prefix)]
    while folders:
        folder, place = folders.pop()
        with os.scandir(folder) as entries:
            for entry in entries:
                name = f'{place}/{entry.name}'
                if entry.is_dir(follow_symlinks=False):
                    folders.append((entry.path, name))
                elif entry.is_file() and not name.endswith(_SHARED_MEMORY):
                    status = entry.stat()
                    yield InputFile(name, status.st_size, status.st_mtime_ns)


def _walk_store(path: RemotePath, place: str) -> Iterator[InputFile]:
    """Yield the files at a URL, by one listing of each folder."""
    from ..files.remote_listing import listing_of, sized_entry_of  # noqa: PLC0415 - for URLs only

    try:
        entry = sized_entry_of(path)
    except (FileNotFoundError, NotADirectoryError):
        return
    if not entry.is_folder:
        yield _stored(place, entry)
        return
    folders = [(path, place)]
    while folders:
        folder, place = folders.pop()
        for name, entry in listing_of(folder).items():
            if entry.is_folder:
                folders.append((folder / name, f'{place}/{name}'))
            else:
                yield _stored(f'{place}/{name}', entry)


def _stored(name: str, entry: RemoteEntry) -> InputFile:
    size = -1 if entry.size is None else entry.size
    return InputFile(name, size, entry.changed_ns, entry.tag)
