# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Globs over the folders of stores, by one listing of each folder that a pattern can match in."""

from __future__ import annotations

from fnmatch import fnmatchcase
from glob import has_magic
from typing import TYPE_CHECKING

from .remote_listing import listing_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from .url_path import UrlPath

_ALL_LEVELS = '**'


def matches_of(pattern: UrlPath) -> list[UrlPath]:
    """Return what matches a URL with *, ? or [...] in its names, or ** for folders of all levels.

    Names that begin with a point match only patterns that do, as in a shell.

    Raises:
        OSError, RemoteError: The store cannot be asked.
    """
    names = pattern.names
    found: Iterable[UrlPath] = [pattern.parents[-1]]
    for position, name in enumerate(names):
        if name == _ALL_LEVELS:
            found = [each for folder in found for each in _levels(folder)]
        elif has_magic(name):
            found = [folder / each for folder in found for each in _matching(folder, name)]
        else:
            found = [folder / name for folder in found]
            if any(map(has_magic, names[:position])):
                found = [each for each in found if each.exists()]
    return sorted(set(found))


def _matching(folder: UrlPath, pattern: str) -> Iterator[str]:
    for name in _names(folder):
        if name.startswith('.') == pattern.startswith('.') and fnmatchcase(name, pattern):
            yield name


def _levels(folder: UrlPath) -> Iterator[UrlPath]:
    """Yield a folder and all folders below it."""
    yield folder
    for name, is_folder in _names(folder).items():
        if is_folder and not name.startswith('.'):
            yield from _levels(folder / name)


def _names(folder: UrlPath) -> dict[str, bool]:
    try:
        return {name: entry.is_folder for name, entry in listing_of(folder).items()}
    except (FileNotFoundError, NotADirectoryError):
        return {}
