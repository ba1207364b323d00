# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A folder that one run at a time writes to, and that does not stay if nothing was written."""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from ..files.output_paths import make_folder
from ..files.staging import lock_exclusively, output_error

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextmanager
def locked_folder(path: Path) -> Iterator[None]:
    """Create a folder, and keep other runs out of it.

    Raises:
        OutputError: Another run is writing to it, or it cannot be created.
    """
    try:
        make_folder(path)
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise output_error(path, error) from error
    try:
        lock_exclusively(folder, path)
        yield
    finally:
        os.close(folder)


@contextmanager
def removed_if_empty(*folders: Path) -> Iterator[None]:
    """Remove folders in the end if nothing is in them, such as after a typing error."""
    try:
        yield
    finally:
        for folder in folders:
            with suppress(OSError):
                folder.rmdir()
