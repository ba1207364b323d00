# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The data that the pages' commands name, from the synthetic recording and a bag of a robot."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import ZipFile

import foreign
from mapped_set import write_mapping

from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticDrive, SyntheticOptions, write_synthetic
from kitti_ros2.synthetic.drive import extract_of, write_extract

from builders import convert_recording  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable

DRIVE = '2011_09_26/2011_09_26_drive_0005_sync'
OPTIONS = SyntheticOptions(frames=12, image_size=(310, 94), lidar_columns=200)


def write_sets(folder: Path) -> Path:
    """The data sets: one of each layout, as KITTI's archives unpack; returns the folder."""
    write_synthetic(folder / 'raw', Layout.RAW, OPTIONS)
    (folder / 'raw' / '2011_09_26').rename(folder / '2011_09_26')
    (folder / 'raw').rmdir()
    (folder / '2011_09_26' / '2011_09_26_drive_0001_sync').rename(folder / DRIVE)
    unsynced = folder / 'unsynced' / 'raw'
    write_extract(unsynced, SyntheticDrive(replace(OPTIONS, extract=True)))
    extract_of(unsynced / DRIVE.replace('0005', '0001')).rename(extract_of(unsynced / DRIVE))
    for layout in (Layout.OBJECT, Layout.ODOMETRY, Layout.TRACKING):
        write_synthetic(folder / layout.value, layout, OPTIONS)
    write_point_labels(folder / 'odometry' / 'sequences' / '00')
    write_mapping_of(folder)
    write_mirror(folder, folder / 'mirror')
    shutil.copytree(folder / 'object' / 'training' / 'label_2', folder / 'results' / 'data')
    tracks = folder / 'tracking' / 'training' / 'label_02'
    shutil.copytree(tracks, folder / 'tracker_results' / 'data')
    shutil.copyfile(folder / 'odometry' / 'poses' / '00.txt', folder / 'estimate_00.txt')
    return folder


def write_mapping_of(folder: Path) -> None:
    """The devkit's mapping of the object frames to two drives, and the time stamps of these."""
    drives = [DRIVE, DRIVE.replace('0005', '0001')]
    rows = [(Path(drives[n % 2]).name, n) for n in range(OPTIONS.frames)]
    write_mapping(folder / 'devkit' / 'mapping', rows, range(1, len(rows) + 1))
    for drive in drives:
        for stamps in (folder / DRIVE).glob('*/timestamps*.txt'):
            copy = folder / 'raw' / drive / stamps.parent.name / stamps.name
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(stamps, copy)


def write_mirror(folder: Path, mirror: Path) -> None:
    """KITTI's archives of a drive, and of the labels of an object set."""
    mirror.mkdir()
    date = DRIVE.partition('/')[0]
    drive = f'{DRIVE.partition("/")[2].removesuffix("_sync")}'
    labels = f'{DRIVE}/tracklet_labels.xml'
    archives = {
        f'{drive}_sync.zip': [each for each in files_in(folder, DRIVE) if each != labels],
        f'{drive}_tracklets.zip': [labels],
        f'{date}_calib.zip': [f'{date}/{each.name}' for each in (folder / date).glob('*.txt')],
    }
    for name, files in archives.items():
        _pack(mirror / name, folder, files)
    _pack(
        mirror / 'data_object_label_2.zip',
        folder / 'object',
        files_in(folder / 'object', 'training/label_2'),
    )


def files_in(folder: Path, part: str) -> list[str]:
    """The files of a part of a folder, relative to the folder."""
    found = (folder / part).rglob('*')
    return sorted(str(each.relative_to(folder)) for each in found if each.is_file())


def _pack(path: Path, folder: Path, files: list[str]) -> None:
    with ZipFile(path, 'w') as archive:
        for name in files:
            archive.write(folder / name, name)


def write_point_labels(sequence: Path) -> None:
    """SemanticKITTI's labels of each scan, all unlabelled."""
    (sequence / 'labels').mkdir()
    for scan in (sequence / 'velodyne').iterdir():
        labels = bytes(scan.stat().st_size // 4)  # 16 bytes a point become 4
        (sequence / 'labels' / f'{scan.stem}.label').write_bytes(labels)


def _convert(source: str, path: Path, folder: Path) -> None:
    convert_recording(folder / source, path)


def _cut(path: Path, folder: Path) -> None:
    whole = folder / 'whole.mcap'
    _convert(DRIVE, whole, folder)
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 5])
    whole.unlink()


def _robot(path: Path, _: Path) -> None:
    foreign.write_foreign(path, foreign.make_truth(), 'ros1' if path.suffix == '.bag' else 'mcap')


BAGS: dict[str, Callable[[Path, Path], None]] = {
    'drive_0005': partial(_convert, DRIVE),
    'drive_0005.mcap': partial(_convert, DRIVE),
    'object_training': partial(_convert, 'object/training'),
    'damaged.mcap': _cut,
    'recording.mcap': _robot,
    'recording.bag': _robot,
    'next.mcap': _robot,
}
"""By name: writes the bag of that name, from the sets in a folder."""


def bags_needed(commands: str) -> list[str]:
    """The names of BAGS that commands read before they write them themselves."""
    needed = []
    for name in BAGS:
        word = rf'(?<![\w./-]){re.escape(name)}(?![\w.-])'
        first = next((line for line in commands.splitlines() if re.search(word, line)), None)
        if first is not None and not re.search(rf'to-bag \S+ {word}', first):
            needed.append(name)
    return needed
