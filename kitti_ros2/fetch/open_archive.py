# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Opens an archive by its first bytes, whatever its name is."""

from __future__ import annotations

import tarfile
from typing import TYPE_CHECKING

from ..model.errors import MissingPathError, naming
from .errors import BadArchiveError
from .tar_archive import MAGICS, TarArchive
from .zip_archive import ZipArchive

if TYPE_CHECKING:
    from pathlib import Path

    from .members import Packed

_ZIP = (b'PK\x03\x04', b'PK\x05\x06')
_TAR_OFFSET = 257
_TAR = b'ustar'


def open_archive(path: Path) -> Packed:
    """Open a zip or tar archive.

    Raises:
        MissingPathError: There is no such file.
        BadArchiveError: The file is no archive, or damaged.
    """
    if not path.exists():
        raise MissingPathError(path)
    if not path.is_file():
        raise BadArchiveError(path, 'is no file', 'give zip or tar archives, then the folder')
    with naming(path), path.open('rb') as file:
        head = file.read(tarfile.BLOCKSIZE)
    if head.startswith(_ZIP):
        return ZipArchive(path)
    if head.startswith(MAGICS) or head[_TAR_OFFSET:].startswith(_TAR):
        return TarArchive(path)
    if not head:
        raise BadArchiveError(path, 'is empty', 'download it again')
    if head.lstrip().lower().startswith((b'<!doctype', b'<html', b'<?xml')):
        found = 'is a web page, such as that of a login, in place of an archive'
        raise BadArchiveError(path, found, 'download it again')
    raise BadArchiveError(path, 'is neither a zip nor a tar archive', 'download it again')
