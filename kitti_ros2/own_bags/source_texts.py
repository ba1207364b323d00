# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The text files in a bag, validated and written: none may overwrite another file."""

from __future__ import annotations

import errno
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..kitti.store import STORE
from ..messages.source import CALIBRATION
from ..model.errors import UsageError
from ..model.losses import Loss
from ..model.streams import Stream
from .folders import is_inside, owner_of, shown

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from pathlib import Path

    from ..model.samples import TextFile
    from .folders import Folder

TEXT_FILE = 'text file'
"""The name of such a file in losses."""

_MOST_PART_BYTES = 255  # NAME_MAX of Linux file systems
_MOST_PATH_BYTES = 1024  # leaves room within PATH_MAX for the folder of the output
_OF_NAME = (errno.EEXIST, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.EINVAL)
"""Errors that a file's own name causes, not the disk."""


class TextFiles:
    """The text files of a recording: paths are unique and do not collide with numbered files.

    Args:
        folders: The folders of the numbered files, by stream.
        listed: By topic the allowed files, besides numbered calibrations; None: any.
    """

    def __init__(
        self,
        folders: Mapping[Stream, Folder],
        listed: Mapping[str, Collection[PurePosixPath] | None],
    ) -> None:
        self._folders = folders
        self._listed = listed
        self._found: dict[PurePosixPath, tuple[str, str]] = {}
        self._doubtful: set[PurePosixPath] = set()
        self._taken = {
            path for folder in folders.values() for path in (folder.path, *folder.path.parents)
        }

    def add(self, topic: str, file: TextFile) -> None:
        """Add a file; one repeated with the same text counts once.

        Raises:
            ValueError: The name is invalid, or belongs to another file or to a folder.
        """
        path = _valid_path(file.name)
        self._refuse_unlisted(topic, path)
        if path not in self._found:
            self._refuse_taken(topic, path)
            self._found[path] = topic, file.text
            self._taken.update(path.parents)
        elif self._found[path][1] != file.text:
            self._doubtful.add(path)  # one of the two has a damaged name, or a damaged text
            raise ValueError(f'a second {path} with another text; neither is written')

    def of(self, topic: str) -> dict[PurePosixPath, str]:
        """Return the texts of a topic by path, in the order added."""
        return {
            path: text
            for path, (origin, text) in self._found.items()
            if origin == topic and path not in self._doubtful
        }

    def _refuse_taken(self, topic: str, path: PurePosixPath) -> None:
        if path in self._taken:
            raise ValueError(f'a text named {path}, which is a folder')
        for place in (path, *path.parents):
            stream, number = owner_of(place, self._folders) or (None, 0)
            if stream is Stream.CALIBRATION and topic == CALIBRATION and place == path:
                return
            if stream is not None:
                raise ValueError(f'a text named {path}, which is {stream.value} {number}')
            if place in self._found:
                raise ValueError(f'a text named {path}, though {place} is a file')

    def _refuse_unlisted(self, topic: str, path: PurePosixPath) -> None:
        listed = self._listed.get(topic)
        stream, _ = owner_of(path, self._folders) or (None, 0)
        if listed is not None and path not in listed and stream is None:
            raise ValueError(
                f'a text named {shown(str(path))}, which the description does not list'
            )


def _valid_path(name: str) -> PurePosixPath:
    if not is_inside(name):
        raise ValueError(f'names a file {shown(name)}, which would lie outside of the output')
    path = PurePosixPath(name)
    longest = max(len(part.encode()) for part in path.parts)
    if longest > _MOST_PART_BYTES or len(name.encode()) > _MOST_PATH_BYTES:
        raise ValueError(f'names a file {shown(name)}, which is too long for a file name')
    return path


def write_texts(
    root: Path, texts: Iterable[tuple[PurePosixPath, str]], bag: Path
) -> tuple[Loss, ...]:
    """Write text files; recordings of a data set may share some.

    Raises:
        UsageError: Another bag has a file of the same name with another text.
        OSError: One cannot be written.
    """
    losses = []
    for path, text in texts:
        target = root / path
        if target.is_file() and STORE.read_text(target) != text:
            raise UsageError(f'{bag}: its {path} differs from that of another bag')
        error = '' if target.is_file() else write_new(target, text.encode())
        if error:
            losses.append(Loss(TEXT_FILE, 1, error))
    return tuple(losses)


def write_new(target: Path, content: bytes | memoryview) -> str:
    """Write a new file; returns the reason if its name is invalid or exists.

    Raises:
        OSError: It cannot be written.
    """
    try:
        STORE.write(target, content, new=True)
    except OSError as error:
        if error.errno not in _OF_NAME:
            raise
        return f'{target.name}: {error.strerror}; the file of that name is kept'
    return ''
