# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of text files that a bag gives: each is checked, so that none overwrites another file."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from .folders import is_inside, owner_of, shown

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..samples import Stream, TextFile
    from .folders import Folder

TEXT_FILE = 'text file'
"""The name of such a file in losses."""

_MOST_PART_BYTES = 255  # NAME_MAX of Linux file systems
_MOST_PATH_BYTES = 1024  # leaves room within PATH_MAX for the folder of the output


class TextFiles:
    """The text files of a recording: no two of one path, none in the way of a numbered file.

    Args:
        folders: Where the numbered files are, by stream.
    """

    def __init__(self, folders: Mapping[Stream, Folder]) -> None:
        self._folders = folders
        self._texts: dict[PurePosixPath, str] = {}
        self._taken = {
            path for folder in folders.values() for path in (folder.path, *folder.path.parents)
        }

    def add(self, file: TextFile, stream: Stream | None = None) -> PurePosixPath:
        """Take a file, and again if it has the same text; returns its path.

        Args:
            file: The name is checked.
            stream: Of which it may be a numbered file.

        Raises:
            ValueError: The name is invalid, or belongs to another file or to a folder.
        """
        path = _valid_path(file.name)
        if path not in self._texts:
            self._refuse_taken(path, stream)
            self._texts[path] = file.text
            self._taken.update(path.parents)
        elif self._texts[path] != file.text:
            raise ValueError(f'a second {path} with another text; the first is kept')
        return path

    def _refuse_taken(self, path: PurePosixPath, stream: Stream | None) -> None:
        if path in self._taken:
            raise ValueError(f'a text named {path}, which is a folder')
        for place in (path, *path.parents):
            owner = owner_of(place, self._folders)
            if owner is not None and owner[0] is not stream:
                raise ValueError(f'a text named {path}, which is {owner[0].value} {owner[1]}')
            if place != path and place in self._texts:
                raise ValueError(f'a text named {path}, though {place} is a file')


def _valid_path(name: str) -> PurePosixPath:
    if not is_inside(name):
        raise ValueError(f'names a file {shown(name)}, which would lie outside of the output')
    path = PurePosixPath(name)
    longest = max(len(part.encode()) for part in path.parts)
    if longest > _MOST_PART_BYTES or len(name.encode()) > _MOST_PATH_BYTES:
        raise ValueError(f'names a file {shown(name)}, which is too long for a file name')
    return path
