# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of outputs and the folders that they need."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

from ..model.errors import UsageError
from .durability import sync_folders


def named_output(path: Path) -> Path:
    """Return the path of an output with its name, also for `.` and paths that end with `..`.

    Raises:
        UsageError: The path has no name.
    """
    if path.name in {'', '..'}:
        path = Path(os.path.realpath(path))
    if not path.name:
        raise UsageError(f'{path} is no place for a bag; give the name of a file or folder to make')
    return path


def make_parents(folder: Path) -> list[Path]:
    """Make a folder and those above it; return the folders that were made, the topmost first.

    Raises:
        OSError: One cannot be made; none is left behind.
    """
    missing = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    created: list[Path] = []
    try:
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            created.append(path)
    except BaseException:
        for path in reversed(created):
            with suppress(OSError):
                path.rmdir()
        raise
    return created


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, all of which outlast a power cut.

    Raises:
        OSError: One cannot be made; none is left behind.
    """
    created = make_parents(folder)
    if created:
        sync_folders(each.parent for each in created)
    elif not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
