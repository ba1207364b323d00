# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives as KITTI is downloaded: their names, and the command that extracts them."""

from __future__ import annotations

import shlex
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from .archive_places import is_known, is_top, places

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

ZIP = '.zip'
TAR = ('.tar', '.tgz', '.tbz2', '.txz', '.tar.gz', '.tar.bz2', '.tar.xz')

OBJECT_CALIB = 'data_object_calib.zip'
TRACKING_CALIB = 'data_tracking_calib.zip'
ODOMETRY_CALIB = 'data_odometry_calib.zip'

_FIRST_ENTRIES = 20
"""Of a tar: further ones would have to be decompressed."""


def raw_calib(date: str) -> str:
    """Return the name of the archive with the calibration of a day."""
    return f'{date}_calib{ZIP}'


def is_archive(name: str) -> bool:
    """Whether a file's name is that of an archive."""
    return name.lower().endswith((ZIP, *TAR))


def extract_command(archives: Sequence[Path], root: Path) -> str:
    """Return the shell command that extracts archives."""
    return shlex.join(['kitti-ros2', 'extract', *map(str, archives), str(root)])


class Archive(NamedTuple):
    """An archive, as it is best extracted.

    Attributes:
        root: The folder to extract into: beside the archive, as the archives of a data set have
            common folders; a new folder for the content of a split, such as label_2.
        folder: The folder to give to other commands then; None if nothing in it is KITTI's.
    """

    root: Path
    folder: Path | None

    @classmethod
    def open(cls, path: Path) -> Archive | None:
        """Read the names in an archive; None if it is damaged or incomplete."""
        is_zip = path.name.lower().endswith(ZIP)
        try:
            files = _files_of_zip(path) if is_zip else _first_files_of_tar(path)
        except Exception:  # noqa: BLE001 - decompressors raise errors of their own
            return None
        known = [name for name in files if '..' not in name and is_known(name, path.name)]
        tops = {place.partition('/')[0] for place in places(known, path.name)}
        if not tops:
            return cls(path.parent, None)
        if not all(is_top(each) for each in tops):
            root = path.with_name(path.name.split('.')[0])
            return cls(root, root)
        return cls(path.parent, path.parent / tops.pop() if len(tops) == 1 else path.parent)


def _files_of_zip(path: Path) -> list[str]:
    from zipfile import ZipFile  # noqa: PLC0415 - for errors only

    with ZipFile(path) as archive:
        return [name for name in archive.namelist() if not name.endswith('/')]


def _first_files_of_tar(path: Path) -> list[str]:
    import tarfile  # noqa: PLC0415 - for errors only

    with tarfile.open(path) as archive:
        return [each.name for each in islice(archive, _FIRST_ENTRIES) if each.isfile()]
