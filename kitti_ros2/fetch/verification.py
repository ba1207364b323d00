# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of downloaded files, and of the space for them."""

from __future__ import annotations

import hashlib
import shutil
from typing import TYPE_CHECKING

from ..model.errors import OutputError, naming
from ..model.text import format_bytes
from .errors import BadArchiveError
from .members import PIECE_BYTES
from .open_archive import open_archive
from .sources import DownloadError

if TYPE_CHECKING:
    from pathlib import Path


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    found = hashlib.sha256()
    with naming(path), path.open('rb') as file:
        while piece := file.read(PIECE_BYTES):
            found.update(piece)
    return found.hexdigest()


def is_complete(path: Path, sha256: str) -> bool:
    """Whether an archive was downloaded before.

    Args:
        path: The archive.
        sha256: Its checksum; empty if it is not known.
    """
    if not path.is_file() or (sha256 and sha256_of(path) != sha256):
        return False
    try:
        with open_archive(path):
            return True
    except BadArchiveError:
        return False


def require_archive(path: Path) -> None:
    """Check that a downloaded file is an archive; remove it if it is not.

    Raises:
        DownloadError: It is not, as with a server that declares too small a size.
    """
    try:
        with open_archive(path):
            pass
    except BadArchiveError as error:
        path.unlink(missing_ok=True)
        found = str(error).partition('; ')[0]
        raise DownloadError(f'{found}, as the server has it; it was removed') from error


def require_space(folder: Path, needed: float, advice: str) -> None:
    """Check the free space of a disk.

    Args:
        folder: A folder on the disk.
        needed: Bytes.
        advice: What to do if they are not free.

    Raises:
        OutputError: They are not.
    """
    free = shutil.disk_usage(folder).free
    if needed > free:
        reason = f'needs about {format_bytes(needed)}, and {format_bytes(free)} are free'
        raise OutputError(folder, reason, f'make room, or {advice}')
