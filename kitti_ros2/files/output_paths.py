# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Names of outputs and the folders that they need."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from ..model.errors import UsageError


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
