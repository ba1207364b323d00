# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives as KITTI is downloaded: their names, and the command that extracts them."""

from __future__ import annotations

import os
import re
import shlex
from itertools import islice, pairwise
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, NamedTuple

from ..files.remote import is_remote
from ..kitti import names
from ..model.streams import Layout

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


# Places of an archive's files in a KITTI tree, whatever folders the archive has above them.
#
# The target is decided by the known folders in a file's name; the folders above them are dropped.
# The first rule that fits is taken:
#
# 1. devkits, archives named `devkit_NAME`: into the folder `devkit_NAME`.
# 2. raw: from the folder of the drive on, in the folder of its date, where calib_*.txt are, too.
#    Files without a drive or date above them take these from the archive's name, such as
#    2011_09_26_drive_0005_tracklets.zip.
# 3. KITTI-360: from `data_2d_raw` and the like on; a drive of its date, or a part of one, goes
#    below the folder that its parts belong to; files of calibration go to `calibration`.
# 4. odometry: `sequences/NN/...` and `poses/NN.txt`, in `dataset`; also `NN/velodyne` and the like.
# 5. object and tracking: from `training`, `testing` or `ImageSets` on.
# 6. folders of a split without the split, such as `label_2`: from that folder on.
# 7. other files: without the folders that stand above all files of the rules 2 to 6.

if TYPE_CHECKING:
    Parts = tuple[str, ...]

_DATE_LENGTH = len('2011_09_26')
_RAW_NAME = re.compile(r'(\d{4}_\d{2}_\d{2}_drive_\d{4})_(sync|extract|tracklets)\b')
_DATE_NAME = re.compile(r'(\d{4}_\d{2}_\d{2})_calib\b')
_DEVKIT_NAME = re.compile(r'devkit_\w+')
_SEQUENCE = re.compile(r'\d{2}')
_POSES = re.compile(r'\d{2}\.txt')
_IN_DRIVE = frozenset({
    *names.RAW_IMAGES, names.RAW_OXTS, names.RAW_SCANS, names.RAW_TRACKLETS,
})  # fmt: skip
_IN_SEQUENCE = frozenset({
    *names.OBJECT_IMAGES, names.SCANS, names.POINT_LABELS, names.ODOMETRY_CALIB, names.TIMES,
})  # fmt: skip
_IN_SPLIT = frozenset({
    *names.OBJECT_IMAGES, *names.TRACKING_IMAGES, names.SCANS, names.CALIB, names.OXTS,
    names.OBJECT_LABELS, names.TRACKING_LABELS,
})  # fmt: skip
_IN_KITTI_360 = {
    **dict.fromkeys(names.RAW_IMAGES, names.KITTI_360_PARTS[0]),
    **dict.fromkeys((names.RAW_SCANS, names.KITTI_360_SICK), names.KITTI_360_PARTS[1]),
    **dict.fromkeys((names.RAW_OXTS, *names.KITTI_360_POSES), names.KITTI_360_PARTS[2]),
}
"""The part of KITTI-360 that a folder or file of a drive belongs to."""
_KITTI_360_FOLDERS = frozenset({
    *names.KITTI_360_PARTS, *names.KITTI_360_TEST_SLAM, 'data_3d_bboxes', 'data_2d_semantics',
    'data_3d_semantics',
})  # fmt: skip
_PARTS_OF_SETS = frozenset({*names.KITTI_360_PARTS, *names.SPLITS, names.SEQUENCES, names.POSES})


def target_paths(files: Sequence[str], archive: str) -> list[str]:
    """Return the target of each file of an archive, relative to the folder to extract into.

    Args:
        files: Names of the files in the archive, with / between their parts.
        archive: Name of the archive.
    """
    split = [tuple(part for part in name.split('/') if part not in {'', '.'}) for name in files]
    pairs = [_locate(parts, archive) for parts in split]
    tops = {parts[:dropped] for parts, (dropped, _) in zip(split, pairs, strict=True) if dropped}
    top = next(iter(tops)) if len(tops) == 1 else ()
    return [
        '/'.join(target or (parts[len(top) :] if parts[: len(top)] == top else parts))
        for parts, (_, target) in zip(split, pairs, strict=True)
    ]


def is_kitti(file: str, archive: str) -> bool:
    """Return whether a file of an archive is in a folder of KITTI's."""
    return bool(_locate(tuple(file.split('/')), archive)[1])


def paths_below(root: Path, paths: Sequence[str]) -> list[str]:
    """Return paths relative to a root that is itself `dataset`, a date, or a part of KITTI-360.

    A root that contains `sequences` counts as `dataset`.
    """
    inside = (
        names.DATASET if (root / names.SEQUENCES).is_dir() else Path(os.path.realpath(root)).name
    )
    tops = (names.DATASET, *names.KITTI_360_PARTS)
    if not (inside in tops or names.RAW_DATE.fullmatch(inside)):
        return list(paths)
    return [path.removeprefix(f'{inside}/') for path in paths]


def is_part_of_set(folder: str) -> bool:
    """Return whether a folder has the name of a split, a date, a drive or sequences."""
    return folder in _PARTS_OF_SETS or bool(
        names.RAW_DRIVE.fullmatch(folder) or names.RAW_DATE.fullmatch(folder)
    )


def is_top(folder: str) -> bool:
    """Return whether a folder is one that KITTI's archives have at their top."""
    top_names = (
        *names.SPLITS, names.DATASET, names.IMAGE_SETS, names.KITTI_360_CALIBRATION,
        *_KITTI_360_FOLDERS,
    )  # fmt: skip
    return folder in top_names or bool(
        _DEVKIT_NAME.fullmatch(folder) or names.RAW_DATE.fullmatch(folder)
    )


def _locate(parts: Parts, archive: str) -> tuple[int, Parts]:
    """Return the number of dropped folders, and the target path; () if no rule fits."""
    devkit = _DEVKIT_NAME.match(archive)
    if devkit is not None:
        own = 1 if len(parts) > 1 and parts[0] in {'devkit', devkit[0]} else 0
        return own, (devkit[0], *parts[own:])
    for rule in (_in_kitti_360, _in_raw, _in_odometry, _in_splits):
        location = rule(parts, archive)
        if location is not None:
            return location
    return 0, ()


def _in_kitti_360(parts: Parts, archive: str) -> tuple[int, Parts] | None:
    drive, top = names.RAW_DRIVE.match(archive), PurePosixPath(archive).stem
    if top in names.KITTI_360_TEST_SLAM and top not in parts:
        return 0, (top, *parts)
    for index, part in enumerate(parts):
        if part in _KITTI_360_FOLDERS and index + 1 < len(parts):
            return index, parts[index:]
        if names.RAW_DRIVE.fullmatch(part) and part.startswith(names.KITTI_360_DATE):
            folder = _IN_KITTI_360.get(parts[index + 1]) if index + 1 < len(parts) else None
            return (index, (folder, *parts[index:])) if folder else None
        if drive and drive[0].startswith(names.KITTI_360_DATE) and part in _IN_KITTI_360:
            return index, (_IN_KITTI_360[part], drive[0], *parts[index:])
    if parts[-1] in names.KITTI_360_CALIB:
        return len(parts) - 1, (names.KITTI_360_CALIBRATION, parts[-1])
    return None


def _in_raw(parts: Parts, archive: str) -> tuple[int, Parts] | None:
    for index, part in enumerate(parts):
        date = part[:_DATE_LENGTH]
        if names.RAW_DRIVE.fullmatch(part):
            above = 1 if index and parts[index - 1] == date else 0
            return index - above, (date, *parts[index:])
        if names.RAW_DATE.fullmatch(part) and parts[index + 1 :][:1] in [
            (name,) for name in names.RAW_CALIB
        ]:
            return index, parts[index:]
    date_name, drive = _DATE_NAME.match(archive), _RAW_NAME.match(archive)
    if date_name is not None and parts[-1] in names.RAW_CALIB:
        return len(parts) - 1, (date_name[1], parts[-1])
    if drive is not None:
        kind = 'extract' if drive[2] == 'extract' else 'sync'
        for index, part in enumerate(parts):
            if part in _IN_DRIVE:
                return index, (drive[1][:_DATE_LENGTH], f'{drive[1]}_{kind}', *parts[index:])
    return None


def _in_odometry(parts: Parts, _: str) -> tuple[int, Parts] | None:
    for index, (part, below) in enumerate(pairwise(parts)):
        of_sequences = part == names.SEQUENCES and _SEQUENCE.fullmatch(below)
        of_poses = part == names.POSES and _POSES.fullmatch(below) and index + 2 == len(parts)
        if of_sequences or of_poses:
            above = 1 if index and parts[index - 1] == names.DATASET else 0
            return index - above, (names.DATASET, *parts[index:])
        if _SEQUENCE.fullmatch(part) and below in _IN_SEQUENCE:
            return index, (names.DATASET, names.SEQUENCES, *parts[index:])
    return None


def _in_splits(parts: Parts, _: str) -> tuple[int, Parts] | None:
    for folder_names in ({*names.SPLITS, names.IMAGE_SETS}, _IN_SPLIT):
        for index, part in enumerate(parts[:-1]):
            if part in folder_names:
                return index, parts[index:]
    return None


ZIP = '.zip'
TAR = ('.tar', '.tgz', '.tbz2', '.txz', '.tar.gz', '.tar.bz2', '.tar.xz')

OBJECT_CALIB = 'data_object_calib.zip'
TRACKING_CALIB = 'data_tracking_calib.zip'
ODOMETRY_CALIB = 'data_odometry_calib.zip'
KITTI_360_CALIB = 'calibration.zip'

_FIRST_ENTRIES = 20
"""Limit for a tar: further ones would have to be decompressed."""


def raw_calib(date: str) -> str:
    """Return the name of the archive with the calibration of a day."""
    return f'{date}_calib{ZIP}'


def is_archive(name: str) -> bool:
    """Return whether a file's name is that of an archive."""
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
        kitti_files = [name for name in files if '..' not in name and is_kitti(name, path.name)]
        tops = {target.partition('/')[0] for target in target_paths(kitti_files, path.name)}
        if not tops:
            return cls(path.parent, None)
        if not all(is_top(top) for top in tops):
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
        return [member.name for member in islice(archive, _FIRST_ENTRIES) if member.isfile()]


# KITTI's archives of calibration files: which one has a missing file, and how it is extracted.

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
            if day == names.KITTI_360_DATE:
                which += f'; in KITTI-360, drives are in {", ".join(names.KITTI_360_PARTS)}'
            return f'the drive needs the calibration of {which}'
        member = f'{day}/{path.name}' if _is_file(path) else day
        archive = raw_calib(day)
        return f'{archive} has it{_command(archive, member, path)}'
    archive, member = _ARCHIVES[layout](path)
    # Sets that others make in KITTI's format have the same names.
    return f"{archive} has it for KITTI's own data{_command(archive, member, path)}"


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
    """Return the archive and the member of a file, or of the folder, of a split."""
    below = path.parts[-3:] if _is_file(path) else path.parts[-2:]
    split = below[0] if below[0] in names.SPLITS else names.SPLITS[0]
    return archive, '/'.join([split, *below[1:]])


def _odometry(path: Path) -> tuple[str, str]:
    member = (names.DATASET, names.SEQUENCES, path.parent.name, path.name)
    return ODOMETRY_CALIB, '/'.join(member)


_ARCHIVES: dict[Layout, Callable[[Path], tuple[str, str]]] = {
    Layout.OBJECT: lambda path: _of_split(OBJECT_CALIB, path),
    Layout.ODOMETRY: _odometry,
    Layout.TRACKING: lambda path: _of_split(TRACKING_CALIB, path),
    Layout.KITTI_360: lambda _: (KITTI_360_CALIB, names.KITTI_360_CALIBRATION),
}
