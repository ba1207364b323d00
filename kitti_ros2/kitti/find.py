# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The recordings of each layout at a path, found by the names of folders and files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from . import names
from .object import ObjectRecording
from .odometry import OdometryRecording
from .raw import RawRecording
from .store import STORE
from .tracking import TrackingRecording

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from ..options.read import ReadOptions
    from .recording import KittiRecording


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


def _splits(path: Path) -> list[Path]:
    return [path / name for name in names.SPLITS if (path / name).is_dir()]


def _subfolders(path: Path, wanted: Callable[[Path], bool]) -> list[Path]:
    return [path / name for name in STORE.names(path) if wanted(path / name)]


def _is_drive(path: Path) -> bool:
    folders = [path / name for name in (*names.RAW_IMAGES, names.RAW_SCANS, names.RAW_OXTS)]
    return any(
        (folder / names.RAW_DATA).is_dir() or (folder / names.TIMESTAMPS).is_file()
        for folder in folders
    )


def _has_frames(path: Path) -> bool:
    """Whether the sub-folders contain images or scans, whatever their names."""
    return _has_files(path, (names.BIN,), names.SCANS) or _has_files(
        path, names.IMAGE_SUFFIXES, *names.OBJECT_IMAGES
    )


def _has_object_text(path: Path) -> bool:
    """Whether the sub-folders contain texts of frames.

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
    """Whether one of the sub-folders has a file of a suffix; of so many digits, if given."""
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
    found: set[str] = set()
    for folder in (names.SCANS, *names.TRACKING_IMAGES):
        found |= {
            name
            for name in STORE.names(split / folder)
            if _is_sequence_name(name) and (split / folder / name).is_dir()
        }
    # Calibrations of frames may have four digits, too.
    texts = () if _is_object_split(split) else (names.CALIB,)
    for folder in (*texts, names.OXTS, names.TRACKING_LABELS):
        found |= {
            name.removesuffix(names.TXT)
            for name in STORE.names(split / folder)
            if name.endswith(names.TXT) and _is_sequence_name(name.removesuffix(names.TXT))
        }
    return sorted(found)


def _is_sequence_name(name: str) -> bool:
    return _is_number(name, names.SEQUENCE_DIGITS)
