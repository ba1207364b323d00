# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The recordings of each layout at a path, found by the names of folders and files."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial, singledispatch
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from ..kitti import names
from ..model.streams import Layout, Stream
from .calib_file import (
    format_object,
    format_odometry,
    format_raw,
    format_tracking,
    parse_raw_calibration,
)
from .kitti360 import Kitti360Recording, Kitti360Writer, drives_at, first_file, parse_kitti360_poses
from .kitti360_calib import format_kitti360_calibration, parse_kitti360_calibration
from .readers import ObjectRecording, OdometryRecording, RawRecording, TrackingRecording
from .store import STORE, Listing
from .text_file import parse_odometry_poses
from .writers import ObjectWriter, OdometryWriter, RawWriter, TrackingWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..model.samples import Calibration
    from ..options.read import ReadOptions
    from .kitti_recording import KittiRecording
    from .text_file import NumberedPoses
    from .writers import LayoutWriter, WriteOptions


@dataclass(frozen=True)
class Candidate:
    """A recording found in a folder.

    Attributes:
        name: Its name for --sequence.
        folder: Its own folder; None if it shares folders with others.
        open: Opens it.
    """

    name: str
    folder: Path | None
    open: Callable[[ReadOptions], KittiRecording]


def absolute(path: Path) -> Path:
    """Return an absolute path whose names are those of folders."""
    try:
        return path.resolve() if '..' in path.parts else path.absolute()
    except RuntimeError:  # symbolic links in a circle, before Python 3.13
        return path.absolute()


def find_raw(path: Path) -> list[Candidate]:
    """Find the drives at a path: a drive itself, those of a date, or those of all dates."""
    drives = [path] if _is_drive(path) else _subfolders(path, _is_drive)
    if not drives:
        for date in _subfolders(path, lambda folder: bool(names.RAW_DATE.fullmatch(folder.name))):
            drives += _subfolders(date, _is_drive)
    return [Candidate(drive.name, drive, partial(RawRecording, drive)) for drive in drives]


def find_object(path: Path) -> list[Candidate]:
    """Find the splits of an object set at a path: the root's, or the split itself."""
    splits = [path] if _is_object_split(path) else []
    splits = splits or [split for split in _splits(path) if _is_object_split(split)]
    return [Candidate(split.name, split, partial(ObjectRecording, split)) for split in splits]


def find_odometry(path: Path) -> list[Candidate]:
    """Find the sequences of an odometry set at a path: all, or the sequence itself."""
    sequences = [path] if _is_sequence(path) else []
    for root in (path, path / names.SEQUENCES, path / names.DATASET / names.SEQUENCES):
        if not sequences and root.name == names.SEQUENCES:
            sequences = _subfolders(root, _is_sequence)
    return [
        Candidate(folder.name, folder, partial(OdometryRecording, folder)) for folder in sequences
    ]


def find_tracking(path: Path) -> list[Candidate]:
    """Find the sequences of a tracking set at a path: the root's, or one split's."""
    candidates = []
    for split in (path, *_splits(path)):
        for sequence in _tracking_sequences(split):
            name = f'testing/{sequence}' if split.name == 'testing' and split != path else sequence
            candidates.append(Candidate(name, None, partial(TrackingRecording, split, sequence)))
    return candidates


def find_kitti360(path: Path) -> list[Candidate]:
    """Find the drives of KITTI-360 at a path: the root's, or one in a folder of a part of it."""
    root, drives = drives_at(path)
    return [Candidate(name, None, partial(Kitti360Recording, root, name)) for name in drives]


def _splits(path: Path) -> list[Path]:
    return [path / name for name in names.SPLITS if (path / name).is_dir()]


def _subfolders(path: Path, is_wanted: Callable[[Path], bool]) -> list[Path]:
    return [path / name for name in STORE.names(path) if is_wanted(path / name)]


def _is_drive(path: Path) -> bool:
    above = path.parent
    if above.name in names.KITTI_360_PARTS or above.parent.name in names.KITTI_360_TEST_SLAM:
        return False
    folders = [path / name for name in (*names.RAW_IMAGES, names.RAW_SCANS, names.RAW_OXTS)]
    return any(
        (folder / names.RAW_DATA).is_dir() or (folder / names.TIMESTAMPS).is_file()
        for folder in folders
    )


def _has_frames(path: Path) -> bool:
    """Return whether the sub-folders contain images or scans, whatever their names."""
    return _has_files(path, (names.BIN,), names.SCANS) or _has_files(
        path, names.IMAGE_SUFFIXES, *names.OBJECT_IMAGES
    )


def _has_object_text(path: Path) -> bool:
    """Return whether the sub-folders contain texts of frames.

    Calibrations of four digits alone are those of tracking sequences, and a folder calib may be
    anyone's.
    """
    texts = (names.TXT,)
    if _has_files(path, texts, *names.LABEL_FOLDERS):
        return True
    return _has_files(
        path, texts, names.CALIB, digits=None if _has_frames(path) else names.FRAME_DIGITS
    )


def _has_files(
    path: Path, suffixes: tuple[str, ...], *folders: str, digits: int | None = None
) -> bool:
    """Return whether one of the sub-folders has a file of a suffix; of so many digits, if given."""
    present = STORE.names(path)
    return any(
        suffix.lower() in suffixes and (digits is None or _is_number(stem, digits))
        for folder in folders
        if folder in present
        for stem, suffix in map(names.split_name, STORE.names(path / folder))
        if not stem.startswith('.')
    )


def _is_number(stem: str, digits: int) -> bool:
    return len(stem) == digits and names.number_of(stem) is not None


def _has_odometry_text(path: Path) -> bool:
    return (
        (path / names.ODOMETRY_CALIB).is_file()
        or (path / names.TIMES).is_file()
        or any(name.endswith(names.LABEL) for name in STORE.names(path / names.POINT_LABELS))
    )


def _is_object_split(path: Path) -> bool:
    if _has_object_text(path):
        return True
    elsewhere = _has_odometry_text(path) or path.parent.name == names.SEQUENCES
    return _has_frames(path) and not elsewhere


def _is_sequence(path: Path) -> bool:
    if _has_odometry_text(path):
        return True
    elsewhere = _has_object_text(path) or path.name in names.SPLITS
    return _has_frames(path) and not elsewhere


def _tracking_sequences(split: Path) -> list[str]:
    """List the sequences of a split: four-digit folders of data, four-digit text files."""
    sequences: set[str] = set()
    for folder in (names.SCANS, *names.TRACKING_IMAGES):
        sequences |= {
            name
            for name in STORE.names(split / folder)
            if _is_sequence_name(name) and (split / folder / name).is_dir()
        }
    # Calibrations of frames may have four digits, too.
    texts = () if _is_object_split(split) else (names.CALIB,)
    for folder in (*texts, names.OXTS, names.TRACKING_LABELS):
        sequences |= {
            name.removesuffix(names.TXT)
            for name in STORE.names(split / folder)
            if name.endswith(names.TXT) and _is_sequence_name(name.removesuffix(names.TXT))
        }
    return sorted(sequences)


def _is_sequence_name(name: str) -> bool:
    return _is_number(name, names.SEQUENCE_DIGITS)


# The files of a recording, and their paths in a data set that holds it alone.
#
# The paths are those of KITTI's archives, however deep in its data set the recording was given:
#
# - raw: DATE/DRIVE and DATE/calib_*.txt
# - object: SPLIT and ImageSets
# - odometry: sequences/NN and poses/NN.txt
# - tracking: SPLIT/*/SSSS and SPLIT/*/SSSS.txt
# - KITTI-360: PART/DRIVE of each part, and calibration
#
# A split of another name than training and testing becomes the root, since readers do not find it
# below one.

if TYPE_CHECKING:
    Part = tuple[Path, PurePosixPath]


@dataclass(frozen=True)
class RecordingTree:
    """The files of a recording.

    Attributes:
        target: Path of the recording in a data set.
        parts: Files and folders of the recording, each with its target.
        scan_root: The folder that is named after the scanner.
        scans: The numbered files of scans, in that folder or below.
        point_labels: Folders with a .label file for scans.
    """

    target: PurePosixPath
    parts: tuple[Part, ...]
    scan_root: Path
    scans: Listing
    point_labels: tuple[Path, ...] = ()

    def target_of(self, path: Path) -> PurePosixPath:
        """Return the target of a file or folder of the recording.

        Raises:
            ValueError: It belongs to no part.
        """
        for source, target in self.parts:
            if path == source or source in path.parents:
                return target / path.relative_to(source).as_posix()
        raise ValueError(f'{path} is no part of {self.target}')


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
    dates = [date for date in (drive.name[:10], root.name) if names.RAW_DATE.fullmatch(date)]
    target = PurePosixPath(*dates[:1])
    calibration = calibration_beside(drive)
    scan_root = drive / names.RAW_SCANS
    return RecordingTree(
        target / drive.name,
        ((drive, target / drive.name), *((path, target / path.name) for path in calibration)),
        scan_root,
        _list_scans(recording, scan_root / names.RAW_DATA, names.TXT),
    )


@tree_of.register
def _(recording: ObjectRecording) -> RecordingTree:
    split, target = recording.split, _split_target(recording.split)
    lists = [
        (text_path, _below_root(text_path, recording.root)) for text_path in recording.text_paths()
    ]
    scans = split / names.SCANS
    return RecordingTree(
        target,
        ((split, target), *(lists if target.name else ())),
        scans,
        _list_scans(recording, scans),
    )


@tree_of.register
def _(recording: OdometryRecording) -> RecordingTree:
    sequence = recording.sequence
    target = PurePosixPath(names.SEQUENCES) / recording.name
    poses = [text_path for text_path in recording.text_paths() if sequence not in text_path.parents]
    folders = [sequence / name for name in STORE.names(sequence) if (sequence / name).is_dir()]
    scans = sequence / names.SCANS
    return RecordingTree(
        target,
        ((sequence, target), *((pose, _below_root(pose, recording.root)) for pose in poses)),
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
    split, target = recording.split, _split_target(recording.split)
    parts = tuple(
        (split / folder / name, target / folder / name)
        for folder in STORE.names(split)
        for name in STORE.names(split / folder)
        if name.partition('.')[0] == recording.name
    )
    scan_root = split / names.SCANS
    return RecordingTree(
        target, parts, scan_root, _list_scans(recording, scan_root / recording.name)
    )


@tree_of.register
def _(recording: Kitti360Recording) -> RecordingTree:
    root, name = recording.root, recording.name
    of_drive = [root / part / name for part in names.KITTI_360_PARTS]
    shared = root / names.KITTI_360_CALIBRATION
    calibration = [shared / file for file in STORE.names(shared) if (shared / file).is_file()]
    paths = [*(path for path in of_drive if path.is_dir()), *calibration]
    parts = tuple((path, _below_root(path, root)) for path in paths)
    parts += tuple((text, _below_root(text, root)) for text in recording.text_paths()
                   if text.parts[len(root.parts)] == names.KITTI_360_BOXES)  # fmt: skip
    drive = root / names.KITTI_360_PARTS[1] / name
    scan_root = drive / names.RAW_SCANS
    scans = _list_scans(recording, scan_root / names.RAW_DATA)
    return RecordingTree(_below_root(drive, root), parts, scan_root, scans)


def _list_scans(recording: KittiRecording, folder: Path, *suffixes: str) -> Listing:
    """List scans; unlike those of the recording, with those that cannot be used."""
    frames = recording.frames
    return STORE.list_numbered(folder, (names.BIN, *suffixes), frames.digits, frames)


def _split_target(split: Path) -> PurePosixPath:
    return PurePosixPath(split.name if split.name in names.SPLITS else '')


def _below_root(path: Path, root: Path) -> PurePosixPath:
    return PurePosixPath(path.relative_to(root).as_posix())


# The reader and the writer of each layout, and names of its text files.
#
# Other differences between layouts are in LayoutTraits.


@dataclass(frozen=True, kw_only=True)
class LayoutFiles:
    """The reader and the writer of a layout, and names of text files.

    Attributes:
        find: Lists the recordings at a path.
        write: Makes a writer below a root folder for a recording of a name.
        line_folders: By line stream (see LayoutTraits) the folder of its text file, or the name of
            the file without suffix.
        stamps: Name of the text file with the stamps of a stream, beside the stream's folder; empty
            in a layout without time.
        format_calibration: Formats a calibration: file name to text, '' for the one file that a
            calibration is.
        calibration_files: Names of the files of a calibration that is several.
        parse_calibration: Parses these: by name the texts of those that exist, their folder, and
            whether the images are rectified.
        parse_poses: Parses the file of poses, if the layout has one.
        first_file: By the name of a recording the first frame that has files; time stamps begin at
            frame 0.
    """

    find: Callable[[Path], list[Candidate]]
    write: Callable[[Path, str, WriteOptions | None], LayoutWriter]
    line_folders: Mapping[Stream, str] = field(default_factory=dict)
    stamps: str = ''
    format_calibration: Callable[[Calibration], Mapping[str, str]]
    calibration_files: tuple[str, ...] = ()
    parse_calibration: Callable[[Mapping[str, str], Path, bool], Calibration] | None = None
    parse_poses: Callable[[str, Path], NumberedPoses] = parse_odometry_poses
    first_file: Callable[[str], int] = lambda _: 0


LAYOUTS = {
    Layout.RAW: LayoutFiles(
        find=find_raw,
        write=lambda root, name, _: RawWriter(root, *names.parse_drive(name)),
        stamps=names.TIMESTAMPS,
        format_calibration=format_raw,
        calibration_files=names.RAW_CALIB,
        parse_calibration=lambda texts, folder, rectified: parse_raw_calibration(
            texts, folder, rectified=rectified
        ),
    ),
    Layout.OBJECT: LayoutFiles(
        find=find_object,
        write=ObjectWriter,
        format_calibration=lambda calibration: {'': format_object(calibration)},
    ),
    Layout.ODOMETRY: LayoutFiles(
        find=find_odometry,
        write=lambda root, name, _: OdometryWriter(root, names.parse_sequence(name)),
        line_folders={Stream.POSE: names.POSES},
        stamps=names.TIMES,
        format_calibration=lambda calibration: {'': format_odometry(calibration)},
    ),
    Layout.TRACKING: LayoutFiles(
        find=find_tracking,
        write=lambda root, name, _: TrackingWriter(root, names.parse_sequence(name)),
        line_folders={
            Stream.OXTS: names.OXTS,
            Stream.POSE: names.OXTS,
            Stream.LABELS: names.TRACKING_LABELS,
        },
        format_calibration=lambda calibration: {'': format_tracking(calibration)},
    ),
    Layout.KITTI_360: LayoutFiles(
        find=find_kitti360,
        write=lambda root, name, _: Kitti360Writer(root, name),
        line_folders={Stream.POSE: names.POSES},
        stamps=names.TIMESTAMPS,
        format_calibration=format_kitti360_calibration,
        calibration_files=names.KITTI_360_CALIB,
        parse_calibration=lambda texts, folder, _: parse_kitti360_calibration(texts, folder),
        parse_poses=parse_kitti360_poses,
        first_file=first_file,
    ),
}


def make_writer(
    layout: Layout, root: Path, name: str, options: WriteOptions | None = None
) -> LayoutWriter:
    """Make the writer of a layout, for a recording of a name; the options are for object sets.

    Raises:
        UsageError: The layout has no such name.
    """
    return LAYOUTS[layout].write(root, name, options)
