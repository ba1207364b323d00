# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The files of a recording, and their places in a data set that holds it alone.

The places are those of KITTI's archives, however deep in its data set the recording was given:

- raw: DATE/DRIVE and DATE/calib_*.txt
- object: SPLIT and ImageSets
- odometry: sequences/NN and poses/NN.txt
- tracking: SPLIT/*/SSSS and SPLIT/*/SSSS.txt

A split of another name than training and testing becomes the root, since readers do not find it
below one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from . import names
from .object import ObjectRecording
from .odometry import OdometryRecording
from .raw import RawRecording
from .store import STORE, Listing
from .tracking import TrackingRecording

if TYPE_CHECKING:
    from pathlib import Path

    from .recording import KittiRecording

    Part = tuple[Path, PurePosixPath]


@dataclass(frozen=True)
class RecordingTree:
    """The files of a recording.

    Attributes:
        place: Of the recording in the data set.
        parts: Files and folders of the recording, each with its place.
        scan_root: The folder that is named after the scanner.
        scans: The numbered files of scans, in that folder or below.
        point_labels: Folders with a .label file for scans.
    """

    place: PurePosixPath
    parts: tuple[Part, ...]
    scan_root: Path
    scans: Listing
    point_labels: tuple[Path, ...] = ()

    def place_of(self, path: Path) -> PurePosixPath:
        """Return the place of a file or folder of the recording.

        Raises:
            ValueError: It belongs to no part.
        """
        for source, place in self.parts:
            if path == source or source in path.parents:
                return place / path.relative_to(source).as_posix()
        raise ValueError(f'{path} is no part of {self.place}')


def calibration_beside(drive: Path) -> list[Path]:
    """Return the calibration files of a raw drive's date."""
    return [drive.parent / name for name in names.RAW_CALIB if (drive.parent / name).is_file()]


@singledispatch
def tree_of(recording: KittiRecording) -> RecordingTree:
    """Return the files of a recording."""
    raise NotImplementedError(recording.layout)


@tree_of.register
def _(recording: RawRecording) -> RecordingTree:
    drive, root = recording.drive, recording.root
    dates = [each for each in (drive.name[:10], root.name) if names.RAW_DATE.fullmatch(each)]
    place = PurePosixPath(*dates[:1])
    calibration = calibration_beside(drive)
    scan_root = drive / names.RAW_SCANS
    return RecordingTree(
        place / drive.name,
        ((drive, place / drive.name), *((path, place / path.name) for path in calibration)),
        scan_root,
        _list_scans(recording, scan_root / names.RAW_DATA, names.TXT),
    )


@tree_of.register
def _(recording: ObjectRecording) -> RecordingTree:
    split, place = recording.split, _split_place(recording.split)
    lists = [(each, _below_root(each, recording.root)) for each in recording.text_paths()]
    scans = split / names.SCANS
    return RecordingTree(
        place,
        ((split, place), *(lists if place.name else ())),
        scans,
        _list_scans(recording, scans),
    )


@tree_of.register
def _(recording: OdometryRecording) -> RecordingTree:
    sequence = recording.sequence
    place = PurePosixPath(names.SEQUENCES) / recording.name
    poses = [each for each in recording.text_paths() if sequence not in each.parents]
    folders = [sequence / name for name in STORE.names(sequence) if (sequence / name).is_dir()]
    scans = sequence / names.SCANS
    return RecordingTree(
        place,
        ((sequence, place), *((each, _below_root(each, recording.root)) for each in poses)),
        scans,
        _list_scans(recording, scans),
        tuple(
            folder
            for folder in folders
            if any(name.endswith(names.LABEL) for name in STORE.names(folder))
        ),
    )


@tree_of.register
def _(recording: TrackingRecording) -> RecordingTree:
    split, place = recording.split, _split_place(recording.split)
    parts = tuple(
        (split / folder / name, place / folder / name)
        for folder in STORE.names(split)
        for name in STORE.names(split / folder)
        if name.partition('.')[0] == recording.name
    )
    scan_root = split / names.SCANS
    return RecordingTree(
        place, parts, scan_root, _list_scans(recording, scan_root / recording.name)
    )


def _list_scans(recording: KittiRecording, folder: Path, *suffixes: str) -> Listing:
    """List scans; unlike those of the recording, with those that cannot be used."""
    frames = recording.frames
    return STORE.list_numbered(folder, (names.BIN, *suffixes), frames.digits, frames)


def _split_place(split: Path) -> PurePosixPath:
    return PurePosixPath(split.name if split.name in names.SPLITS else '')


def _below_root(path: Path, root: Path) -> PurePosixPath:
    return PurePosixPath(path.relative_to(root).as_posix())
