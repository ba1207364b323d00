# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Places of an archive's files in a KITTI tree, whatever folders the archive has above them.

The place is decided by the known folders in a file's name; the folders above them are dropped. The
first rule that fits is taken:

1. devkits, archives named `devkit_NAME`: into the folder `devkit_NAME`.
2. raw: from the folder of the drive on, in the folder of its date, where calib_*.txt are, too.
   Files without a drive or date above them take these from the archive's name, such as
   2011_09_26_drive_0005_tracklets.zip.
3. odometry: `sequences/NN/...` and `poses/NN.txt`, in `dataset`; also `NN/velodyne` and the like.
4. object and tracking: from `training`, `testing` or `ImageSets` on.
5. folders of a split without the split, such as `label_2`: from that folder on.
6. other files: without the folders that stand above all files of the rules 2 to 5.
"""

from __future__ import annotations

import os
import re
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from . import names

if TYPE_CHECKING:
    from collections.abc import Sequence

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
_PARTS_OF_SETS = frozenset({*names.SPLITS, names.SEQUENCES, names.POSES})


def places(files: Sequence[str], archive: str) -> list[str]:
    """Return the place of each file of an archive, relative to the folder to extract into.

    Args:
        files: Names of the files in the archive, with / between their parts.
        archive: Name of the archive.
    """
    split = [tuple(part for part in name.split('/') if part not in {'', '.'}) for name in files]
    known = [_known(parts, archive) for parts in split]
    tops = {parts[:dropped] for parts, (dropped, _) in zip(split, known, strict=True) if dropped}
    top = next(iter(tops)) if len(tops) == 1 else ()
    return [
        '/'.join(place or (parts[len(top) :] if parts[: len(top)] == top else parts))
        for parts, (_, place) in zip(split, known, strict=True)
    ]


def is_known(file: str, archive: str) -> bool:
    """Whether a file of an archive is in a folder of KITTI's."""
    return bool(_known(tuple(file.split('/')), archive)[1])


def places_in(root: Path, wanted: Sequence[str]) -> list[str]:
    """Return places relative to a root that is itself the folder `dataset`, or that of a date.

    A root that contains `sequences` counts as `dataset`.
    """
    inside = (
        names.DATASET if (root / names.SEQUENCES).is_dir() else Path(os.path.realpath(root)).name
    )
    if not (inside == names.DATASET or names.RAW_DATE.fullmatch(inside)):
        return list(wanted)
    return [place.removeprefix(f'{inside}/') for place in wanted]


def is_part_of_set(folder: str) -> bool:
    """Whether a folder is named like a part of a data set: a split, a date, a drive, sequences."""
    return folder in _PARTS_OF_SETS or bool(
        names.RAW_DRIVE.fullmatch(folder) or names.RAW_DATE.fullmatch(folder)
    )


def is_top(folder: str) -> bool:
    """Whether a folder is one that KITTI's archives have at their top."""
    known = (*names.SPLITS, names.DATASET, names.IMAGE_SETS)
    return folder in known or bool(
        _DEVKIT_NAME.fullmatch(folder) or names.RAW_DATE.fullmatch(folder)
    )


def _known(parts: Parts, archive: str) -> tuple[int, Parts]:
    """Return the number of folders that are dropped, and the place; () if no rule fits."""
    devkit = _DEVKIT_NAME.match(archive)
    if devkit is not None:
        own = 1 if len(parts) > 1 and parts[0] in {'devkit', devkit[0]} else 0
        return own, (devkit[0], *parts[own:])
    for rule in (_in_raw, _in_odometry, _in_splits):
        found = rule(parts, archive)
        if found is not None:
            return found
    return 0, ()


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
    for known in ({*names.SPLITS, names.IMAGE_SETS}, _IN_SPLIT):
        for index, part in enumerate(parts[:-1]):
            if part in known:
                return index, parts[index:]
    return None
