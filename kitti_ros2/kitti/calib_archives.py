# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives of calibration files: which one has a missing file, and how it is extracted."""

from __future__ import annotations

import shlex
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..files.remote import is_remote
from ..model.layouts import Layout
from . import archives, names

if TYPE_CHECKING:
    from collections.abc import Callable


def describe_source(layout: Layout, path: Path) -> str:
    """Describe how to get a missing calibration file, for the end of a message.

    Args:
        layout: The layout of the recording.
        path: The file, or the folder of several.
    """
    archive, member = _ARCHIVES[layout](path)
    if is_remote(path):
        return f'{archive} has it'
    parts = PurePosixPath(member).parts
    for own in (parts, parts[1:]) if parts[0] == names.DATASET else (parts,):
        if path.parts[-len(own) :] == own:
            root = Path(*path.parts[: -len(own)])
            return f'{archive} has it ({archives.extract_command([Path(archive)], root)})'
    # Other folders than in the archive: without them.
    target, members = (path.parent, member) if _is_file(path) else (path, f'{member}/*')
    command = f'unzip -j {archive} {shlex.quote(members)} -d {shlex.quote(str(target))}'
    return f'{archive} has it ({command})'


def _is_file(path: Path) -> bool:
    return path.suffix == names.TXT  # it does not exist


def _raw(path: Path) -> tuple[str, str]:
    dates = [part[: len('2011_09_26')] for part in path.parts if names.RAW_DATE.match(part)]
    date = dates[-1] if dates else '2011_09_26'
    return archives.raw_calib(date), f'{date}/{path.name}' if _is_file(path) else date


def _of_split(archive: str, path: Path) -> tuple[str, str]:
    """Return the archive, and the place in it of a file, or of the folder, of a split."""
    below = path.parts[-3:] if _is_file(path) else path.parts[-2:]
    split = below[0] if below[0] in names.SPLITS else names.SPLITS[0]
    return archive, '/'.join([split, *below[1:]])


def _odometry(path: Path) -> tuple[str, str]:
    place = (names.DATASET, names.SEQUENCES, path.parent.name, path.name)
    return archives.ODOMETRY_CALIB, '/'.join(place)


_ARCHIVES: dict[Layout, Callable[[Path], tuple[str, str]]] = {
    Layout.RAW: _raw,
    Layout.OBJECT: lambda path: _of_split(archives.OBJECT_CALIB, path),
    Layout.ODOMETRY: _odometry,
    Layout.TRACKING: lambda path: _of_split(archives.TRACKING_CALIB, path),
}
