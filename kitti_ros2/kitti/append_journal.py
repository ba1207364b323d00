# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The journal of an append to an object set; with it an incomplete append is undone.

While frames are appended, the set holds the folder ``.to-kitti-append``:

==================  ================================================================================
entry               content
==================  ================================================================================
``content/``        the new files that are not moved yet, at the paths that they get in the set
``before/``         the lists of frames (ImageSets) that are continued, as they were
``journal.json``    present while files are moved; the next reader or writer undoes the append
``committed.json``  the same content, once every file is in its place
==================  ================================================================================

A file of the journal is in the set if, and only if, it is missing in ``content/``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from ..model.errors import BadFileError
from . import names
from .store import STORE

if TYPE_CHECKING:
    from pathlib import Path

FOLDER = '.to-kitti-append'
CONTENT = 'content'
BEFORE = 'before'
JOURNAL = 'journal.json'
COMMITTED = 'committed.json'

_VERSION = 1


@dataclass(frozen=True)
class AppendJournal:
    """The files that an append adds to a set; all paths are relative to the set's folder.

    Attributes:
        split: training or testing.
        files: The files that the set did not have, in the order of moving: those of frames, then
            lists of frames.
        lists: The lists of frames that are continued, moved after all files.
        folders: Folders that the set did not have, parents first.
    """

    split: str
    files: tuple[PurePosixPath, ...]
    lists: tuple[PurePosixPath, ...]
    folders: tuple[PurePosixPath, ...]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the frames, ascending."""
        stems = {path.stem for path in self.files if path.parts[0] == self.split}
        return tuple(sorted(int(stem) for stem in stems if stem.isdecimal()))


def format_journal(journal: AppendJournal) -> str:
    """Format a journal; the inverse of parse_journal."""
    paths = {
        name: [str(path) for path in getattr(journal, name)]
        for name in ('files', 'lists', 'folders')
    }
    return json.dumps({'version': _VERSION, 'split': journal.split, **paths}, indent=0) + '\n'


def parse_journal(text: str, path: Path | str) -> AppendJournal:
    """Parse a journal.

    Raises:
        BadFileError: The text is no journal, or contains a path that an append does not write.
    """
    try:
        return _parse_values(json.loads(text))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        found = ' '.join(f'{type(error).__name__}: {error}'.split())[:200]
        remedy = 'move it away, and look for files of incomplete frames'
        raise BadFileError(path, found, 'the journal of an append', remedy=remedy) from None


def _parse_values(values: Any) -> AppendJournal:  # noqa: ANN401 - of JSON
    if values['version'] != _VERSION or values['split'] not in names.SPLITS:
        raise ValueError(f'version {values["version"]!r}, split {values["split"]!r}')
    split = values['split']
    return AppendJournal(
        split,
        tuple(_path(item, split, names.IMAGE_SETS) for item in values['files']),
        tuple(_path(item, names.IMAGE_SETS) for item in values['lists']),
        tuple(_path(item, split, names.IMAGE_SETS) for item in values['folders']),
    )


def find_journal(root: Path) -> AppendJournal | None:
    """Find the journal of an incomplete append to a set, None without one.

    Raises:
        BadFileError: The journal is invalid.
        OSError: It cannot be read.
    """
    path = root / FOLDER / JOURNAL
    try:
        text = STORE.read_text(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return parse_journal(text, path)


def _path(item: Any, *tops: str) -> PurePosixPath:  # noqa: ANN401 - of JSON
    """Parse a path; it must be below one of the folders, as undoing deletes files there."""
    path = PurePosixPath(item)
    if path.parts[:1] not in [(top,) for top in tops] or '..' in path.parts:
        raise ValueError(f'path {item!r}')
    return path
