# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The folders of a collection: roots, globs and lists; the folders below them."""

from __future__ import annotations

import glob
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..files import remote
from ..kitti.find import absolute
from ..model.errors import MissingPathError, UsageError, describe_error, naming

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Visit = Callable[[Path, Sequence[str], Sequence[str]], Sequence[str]]

_LIST = '.txt'
_MOST_LEVELS = 8


def find_roots(source: Path, is_file: Callable[[Path], bool] | None = None) -> list[Path]:
    """Return the folders of a collection: a root itself, the matches of a glob, or a list's.

    A list is a text file with one path or URL per line, relative to the list; # begins a comment.

    Args:
        source: A path as the user gave it.
        is_file: Whether a file that a glob matches is meant, too; None for folders only.

    Raises:
        KittiRos2Error: There is no such path.
        OSError: The list cannot be read.
    """
    noun = 'folder' if is_file is None else 'folder or file'
    if source.is_file() and source.suffix == _LIST:
        found = list(_listed(source))
        if not found:
            raise UsageError(f'{source}: names no {noun}; expected one path per line')
    elif source.exists() or not glob.has_magic(str(source)):
        return [source]
    else:
        found = [
            path
            for path in _matches(source)
            if path.is_dir() or (is_file is not None and is_file(path))
        ]
        if not found:
            raise UsageError(f'{source}: no {noun} matches; quote the pattern, or give a root')
    for path in found:
        if not path.exists():
            raise MissingPathError(path)
    return list(dict.fromkeys(found))


def find_all_roots(
    sources: Sequence[Path], is_file: Callable[[Path], bool] | None = None
) -> list[Path]:
    """Return the folders of several collections, as find_roots."""
    return list(dict.fromkeys(root for each in sources for root in find_roots(each, is_file)))


def _listed(path: Path) -> Iterator[Path]:
    try:
        with naming(path):
            lines = path.read_text('utf-8').splitlines()
    except UnicodeDecodeError:
        raise UsageError(f'{path}: not UTF-8 text; expected one path per line') from None
    for line in lines:
        text = line.partition('#')[0].strip()
        if text:
            given = remote.as_path(text)
            yield given if remote.is_remote(given) else path.parent / given


def _matches(pattern: Path) -> list[Path]:
    if remote.is_remote(pattern):
        from ..files.remote_glob import matches_of  # noqa: PLC0415 - for URLs only

        return [*matches_of(pattern)]
    found = glob.glob(str(pattern), recursive=True)  # noqa: PTH207 - it may be absolute
    return [Path(each) for each in sorted(found)]


def common_folder(roots: Sequence[Path]) -> Path:
    """Return the only root, or the folder that holds all of several.

    Raises:
        UsageError: They are in several stores, or in a store and on this machine.
    """
    if len(roots) == 1:
        return absolute(roots[0])
    try:
        return remote.common_folder([absolute(root).parent for root in roots])
    except ValueError:
        raise UsageError(
            f'{roots[0]} and {roots[-1]} are in no common folder; run one command for each store'
        ) from None


def relative_name(path: Path, base: Path) -> str:
    """Return the name of a path below a folder; of the folder itself its own name."""
    return path.name if path == base else Path(remote.relative_place(path, base)).as_posix()


@dataclass
class FolderSearch:
    """A search of folders for units, and what it could not search.

    Attributes:
        exclude: Folders that are not searched, such as the output.
        problems: What could not be searched, or has no counterpart, one line for each.
    """

    exclude: Sequence[Path] = ()
    problems: list[str] = field(default_factory=list)

    def nothing(self) -> UsageError | None:
        """Return the error for a search that found nothing, if folders could not be read."""
        return UsageError(f'nothing is found; {self.problems[0]}') if self.problems else None

    def walk(self, root: Path, visit: Visit) -> None:
        """Visit a folder and the folders below it, each once, also if links lead back.

        Hidden folders are not visited, nor those more than eight levels below.

        Args:
            root: The first folder.
            visit: Called with a folder, the names of its folders and of its other entries, both
                in order; returns the names of the folders to visit.

        Raises:
            OSError: The first folder cannot be read.
        """
        excluded = {remote.real_place(each) for each in self.exclude}
        seen: set[str] = set()
        stack = [(root, 0)]
        while stack:
            folder, level = stack.pop()
            place = remote.real_place(folder)  # links may lead back
            if place in seen or place in excluded:
                continue
            seen.add(place)
            try:
                folders, others = _entries(folder)
            except OSError as error:
                if not level:
                    raise
                self.problems.append(describe_error(error))
                continue
            below = visit(folder, folders, others)
            if below and level == _MOST_LEVELS:
                self.problems.append(
                    f'{folder}: the folders in it are more than {_MOST_LEVELS} levels below {root};'
                    f' give it as a root of its own'
                )
                continue
            stack += [(folder / name, level + 1) for name in reversed(below)]


def _entries(folder: Path) -> tuple[list[str], list[str]]:
    """Return the names of the folders in a folder, and of its other entries, without hidden."""
    folders: list[str] = []
    others: list[str] = []
    if remote.is_remote(folder):
        from ..files.remote_listing import listing_of  # noqa: PLC0415 - for URLs only

        for name, entry in listing_of(folder).items():
            if not name.startswith('.'):
                (folders if entry.is_folder else others).append(name)
        return folders, others
    with os.scandir(folder) as entries:
        for each in entries:
            if not each.name.startswith('.'):
                (folders if _is_folder(each) else others).append(each.name)
    return sorted(folders), sorted(others)


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:  # a link to itself
        return False
