# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""An object set with holes in its numbers, the devkit's mapping, and the stamps of raw drives."""

from __future__ import annotations

import shutil
from pathlib import Path  # noqa: TC003 - NamedTuple evaluates it
from typing import NamedTuple

from folder_and_bag import make_holes

from kitti_ros2.kitti.text_file import format_timestamps
from kitti_ros2.model.streams import Layout, parse_stamp

A = '2011_09_26_drive_0001_sync'
B = '2011_09_26_drive_0005_sync'
C = '2011_10_03_drive_0047_sync'
DRIVES = {
    A: parse_stamp('2011-09-26 13:02:25.951199337'),
    B: parse_stamp('2011-09-26 13:04:32.345808896'),
    C: parse_stamp('2011-10-03 12:55:34.930000001'),
}
"""The stamp of each drive's first scan."""

FRAMES = 12
"""Of each drive; C has 8 in the mapping."""
ROWS = [(drive, number) for drive in (A, B) for number in range(FRAMES)]
ROWS += [(C, number) for number in range(8)]
RAND = [(frame * 5 + 3) % len(ROWS) + 1 for frame in range(len(ROWS))]
IN_TIME = (8, 15, 16, 10, 30)
"""The frames of the set, in order of their true stamps."""

_FILES = {
    'velodyne_points/timestamps.txt': 0,
    'velodyne_points/timestamps_start.txt': -51_000_000,
    'velodyne_points/timestamps_end.txt': 52_000_001,
    'image_02/timestamps.txt': 10_487_531,
    'image_03/timestamps.txt': 10_487_000,
}


class MappedSet(NamedTuple):
    """The folders of a set, its mapping and its raw drives, side by side."""

    folder: Path

    @property
    def object(self) -> Path:
        return self.folder / 'object'

    @property
    def mapping(self) -> Path:
        return self.folder / 'devkit' / 'object' / 'mapping'

    @property
    def raw(self) -> Path:
        return self.folder / 'raw'

    def drive(self, name: str) -> Path:
        return self.raw / name[:10] / name


def true_stamp(frame: int, file: str = 'velodyne_points/timestamps.txt') -> int:
    """The stamp of an object frame."""
    drive, number = ROWS[RAND[frame] - 1]
    return _stamps(drive, _FILES[file])[number]


def _stamps(drive: str, offset_ns: int) -> list[int]:
    return [DRIVES[drive] + offset_ns + 103_600_000 * number for number in range(FRAMES)]


def write_mapping(folder: Path, rows=ROWS, rand=RAND) -> Path:
    """Write the two files of the mapping."""
    folder.mkdir(parents=True)
    lines = [f'{drive[:10]} {drive} {number:010d}\n' for drive, number in rows]
    (folder / 'train_mapping.txt').write_text(''.join(lines), 'utf-8')
    (folder / 'train_rand.txt').write_text(','.join(map(str, rand)) + '\n', 'utf-8')
    return folder


def make_mapped_set(recordings: dict[Layout, Path], folder: Path) -> MappedSet:
    """Write an object set with its mapping and the stamps of its drives, in a new folder."""
    holed = make_holes(recordings[Layout.OBJECT], Layout.OBJECT, folder / 'made')
    made = MappedSet(folder)
    shutil.move(holed, made.object)
    write_mapping(made.mapping)
    for drive in DRIVES:
        for name, offset_ns in _FILES.items():
            file = made.drive(drive) / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(format_timestamps(_stamps(drive, offset_ns)), 'utf-8')
    return made
