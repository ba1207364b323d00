# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's archives of calibration files: which one has a missing file, and how it is extracted."""

from __future__ import annotations

import shlex
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from ..files.remote import is_remote
from ..model.layouts import Layout
from . import names
from .archives import OBJECT_CALIB, ODOMETRY_CALIB, TRACKING_CALIB, extract_command, raw_calib

if TYPE_CHECKING:
    from collections.abc import Callable


CALIB_TIMES = {
    '09-Jan-2012 13:57:47': '2011_09_26',
    '09-Jan-2012 13:58:50': '2011_09_28',
    '09-Jan-2012 13:59:12': '2011_09_29',
    '09-Jan-2012 13:59:33': '2011_09_30',
    '09-Jan-2012 14:00:15': '2011_10_03',
}
"""The days of KITTI's raw data, by the calib_time in their calib_cam_to_cam.txt.

Source: the files of the five days; calib_time is when a calibration was computed, in 2012.
"""


def describe_source(layout: Layout, path: Path, drive: str = '') -> str:
    """Describe how to get a missing calibration file, for the end of a message.

    Args:
        layout: The layout of the recording.
        path: The file, or the folder of several.
        drive: The name of a raw drive; it begins with the day whose calibration it needs.
    """
    if layout is Layout.RAW:
        day = _day_of(path, drive)
        if day not in CALIB_TIMES.values():
            which = f'{day}, which is no day of KITTI' if day else 'its own day'
            return f'the drive needs the calibration of {which}'
        place = f'{day}/{path.name}' if _is_file(path) else day
        archive = raw_calib(day)
        return f'{archive} has it{_command(archive, place, path)}'
    archive, place = _ARCHIVES[layout](path)
    # Sets that others make in KITTI's format have the same names.
    return f"{archive} has it for KITTI's own data{_command(archive, place, path)}"


def _command(archive: str, member: str, path: Path) -> str:
    """Return the command that extracts a file or folder, in brackets; '' at a URL."""
    if is_remote(path):
        return ''
    parts = PurePosixPath(member).parts
    for own in (parts, parts[1:]) if parts[0] == names.DATASET else (parts,):
        if path.parts[-len(own) :] == own:
            root = Path(*path.parts[: -len(own)])
            return f' ({extract_command([Path(archive)], root)})'
    # Other folders than in the archive: without them.
    target, members = (path.parent, member) if _is_file(path) else (path, f'{member}/*')
    return f' (unzip -j {archive} {shlex.quote(members)} -d {shlex.quote(str(target))})'


def day_of_drive(name: str) -> str:
    """Return the day in the name of a raw drive, such as 2011_09_26; '' for another name."""
    day = names.RAW_DATE.match(name)
    return day[0] if day else ''


def _day_of(path: Path, drive: str) -> str:
    """Return the day of a drive's name, else that of the folders around it; '' without one."""
    days = [day_of_drive(part) for part in (*path.parts, drive)]
    return next((day for day in reversed(days) if day), '')


def _is_file(path: Path) -> bool:
    return path.suffix == names.TXT  # it does not exist


def _of_split(archive: str, path: Path) -> tuple[str, str]:
    """Return the archive, and the place in it of a file, or of the folder, of a split."""
    below = path.parts[-3:] if _is_file(path) else path.parts[-2:]
    split = below[0] if below[0] in names.SPLITS else names.SPLITS[0]
    return archive, '/'.join([split, *below[1:]])


def _odometry(path: Path) -> tuple[str, str]:
    place = (names.DATASET, names.SEQUENCES, path.parent.name, path.name)
    return ODOMETRY_CALIB, '/'.join(place)


_ARCHIVES: dict[Layout, Callable[[Path], tuple[str, str]]] = {
    Layout.OBJECT: lambda path: _of_split(OBJECT_CALIB, path),
    Layout.ODOMETRY: _odometry,
    Layout.TRACKING: lambda path: _of_split(TRACKING_CALIB, path),
}
