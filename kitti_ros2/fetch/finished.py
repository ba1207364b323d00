# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The record of archives that were extracted: they are not downloaded again."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import TYPE_CHECKING

from ..files.durability import replace_file
from .errors import stopping

if TYPE_CHECKING:
    from pathlib import Path

_NAME = 'extracted.json'


class FinishedArchives:
    """The archives of which everything was extracted, by name, each with some of its files.

    Args:
        root: The folder that the files are in.
        folder: Where the record is.
        fsync: Whether it outlasts a power cut.
    """

    def __init__(self, root: Path, folder: Path, *, fsync: bool) -> None:
        self._root = root
        self._fsync = fsync
        self._path = folder / _NAME
        self._files: dict[str, list[str]] = {}
        with suppress(OSError, ValueError):
            found = json.loads(self._path.read_text('utf-8'))
            if isinstance(found, dict):
                self._files = {str(name): [*map(str, files)] for name, files in found.items()}

    def __contains__(self, name: str) -> bool:
        """Whether an archive was extracted, and its files are still there."""
        files = self._files.get(name, [])
        return bool(files) and all((self._root / each).is_file() for each in files)

    def add(self, name: str, files: list[str]) -> None:
        """Record that an archive was extracted.

        Raises:
            StoppedError: The disk refuses.
        """
        self._files[name] = files
        part = self._path.with_name(f'.{_NAME}.part')
        with stopping(self._path):
            part.write_text(json.dumps(self._files, indent=1), encoding='utf-8')
            replace_file(part, self._path, fsync=self._fsync)
