# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reader and the writer of each layout; detects the layout of a folder and opens it.

What else differs between layouts is in LayoutTraits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from ..model.errors import AmbiguousLayoutError, AmbiguousSequenceError, NotKittiError, UsageError
from ..model.layouts import Layout
from ..model.streams import Stream
from ..options.read import ReadOptions
from . import names
from .object import ObjectRecording
from .odometry import OdometryRecording
from .raw import RawRecording
from .store import STORE
from .tracking import TrackingRecording
from .write_object import ObjectWriter
from .write_odometry import OdometryWriter
from .write_raw import RawWriter
from .write_tracking import TrackingWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from .recording import KittiRecording
    from .write_object import WriteOptions
    from .writer import LayoutWriter


@dataclass(frozen=True)
class Candidate:
    """A recording found in a folder: its name for --sequence, and a function that opens it."""

    name: str
    open: Callable[[ReadOptions], KittiRecording]


def find_raw(path: Path) -> list[Candidate]:
    """Find the drives at a path: a drive itself, those of a date, or those of all dates."""
    drives = [path] if _is_drive(path) else _subfolders(path, _is_drive)
    if not drives:
        for date in _subfolders(path, lambda folder: bool(names.RAW_DATE.fullmatch(folder.name))):
            drives += _subfolders(date, _is_drive)
    return [Candidate(drive.name, partial(RawRecording, drive)) for drive in drives]


def find_object(path: Path) -> list[Candidate]:
    """Find the splits of an object set at a path: the root's, or the split itself."""
    splits = [path] if _is_object_split(path) else []
    splits = splits or [path / name for name in names.SPLITS if _is_object_split(path / name)]
    return [Candidate(split.name, partial(ObjectRecording, split)) for split in splits]


def find_odometry(path: Path) -> list[Candidate]:
    """Find the sequences of an odometry set at a path: all, or the sequence itself."""
    sequences = [path] if _is_sequence(path) else []
    for root in (path, path / names.SEQUENCES, path / 'dataset' / names.SEQUENCES):
        if not sequences and root.name == names.SEQUENCES:
            sequences = _subfolders(root, _is_sequence)
    return [Candidate(folder.name, partial(OdometryRecording, folder)) for folder in sequences]


def find_tracking(path: Path) -> list[Candidate]:
    """Find the sequences of a tracking set at a path: the root's, or one split's."""
    candidates = []
    for split in (path, *(path / name for name in names.SPLITS)):
        for sequence in _tracking_sequences(split):
            name = f'testing/{sequence}' if split.name == 'testing' and split != path else sequence
            candidates.append(Candidate(name, partial(TrackingRecording, split, sequence)))
    return candidates


@dataclass(frozen=True)
class LayoutFiles:
    """The reader and the writer of a layout.

    Attributes:
        find: Lists the recordings at a path.
        write: Makes a writer below a root folder for a recording of a name.
        line_folders: By line stream (see LayoutTraits) the folder of its text file, or the name of
            the file without suffix.
        stamps: Name of the text file with the stamps of a stream, beside the stream's folder; empty
            in a layout without time.
    """

    find: Callable[[Path], list[Candidate]]
    write: Callable[[Path, str, WriteOptions | None], LayoutWriter]
    line_folders: Mapping[Stream, str] = field(default_factory=dict)
    stamps: str = ''


LAYOUTS = {
    Layout.RAW: LayoutFiles(
        find_raw,
        lambda root, name, _: RawWriter(root, *names.parse_drive(name)),
        stamps=names.TIMESTAMPS,
    ),
    Layout.OBJECT: LayoutFiles(find_object, ObjectWriter),
    Layout.ODOMETRY: LayoutFiles(
        find_odometry,
        lambda root, name, _: OdometryWriter(root, names.parse_sequence(name)),
        {Stream.POSE: names.POSES},
        stamps=names.TIMES,
    ),
    Layout.TRACKING: LayoutFiles(
        find_tracking,
        lambda root, name, _: TrackingWriter(root, names.parse_sequence(name)),
        {
            Stream.OXTS: names.OXTS,
            Stream.POSE: names.OXTS,
            Stream.LABELS: names.TRACKING_LABELS,
        },
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


def guess_layout(path: Path) -> Layout:
    """Detect the layout of a folder.

    Raises:
        NotKittiError: There is no such folder, or it fits no layout.
        AmbiguousLayoutError: It fits several.
    """
    if not path.is_dir():
        found = 'is a file' if path.exists() else 'no such folder'
        raise NotKittiError(path, found, [layout.value for layout in LAYOUTS])
    fits = [layout for layout, files in LAYOUTS.items() if files.find(path)]
    if not fits:
        entries = STORE.names(path)
        found = f'holds {", ".join(entries[:4])}' if entries else 'the folder is empty'
        raise NotKittiError(path, found, [layout.value for layout in LAYOUTS])
    if len(fits) > 1:
        raise AmbiguousLayoutError(path, [layout.value for layout in fits])
    return fits[0]


def open_recording(path: Path, options: ReadOptions | None = None) -> KittiRecording:
    """Open the recording at a path; lists folders, reads time stamps and sequence-wide files only.

    Raises:
        NotKittiError: There is no recording.
        AmbiguousLayoutError: The folder fits several layouts and the options contain none.
        AmbiguousSequenceError: It contains several recordings and the options choose none.
        UsageError: The chosen recording does not exist, or the options request labels of points
            and the layout has none.
    """
    options = options or ReadOptions()
    path = path.resolve() if '..' in path.parts else path.absolute()
    layout = options.layout or guess_layout(path)
    if options.semantic and not layout.traits.point_labels:
        raise UsageError(
            f'{path}: semantic is for the odometry layout, which has labels of points;'
            f' this is layout {layout.value}'
        )
    candidates = LAYOUTS[layout].find(path) if path.is_dir() else []
    if not candidates:
        found = f'no {layout.value} recording' if path.exists() else 'no such folder'
        raise NotKittiError(path, found, [layout.value])
    chosen = _choose(path, layout, candidates, options.sequence)
    recording = chosen.open(options)
    if not recording.streams:
        reasons = [loss.message for loss in recording.losses]
        found = '; '.join([f'no data file of {chosen.name} can be used', *reasons[:1]])
        raise NotKittiError(path, found, [layout.value])
    others = [candidate.name for candidate in candidates if candidate is not chosen]
    if layout.traits.frame_set and others and options.sequence is None:
        recording.notes.append(
            f'{path}: {", ".join(others)} left out; --sequence {others[0]} takes it'
        )
    return recording


def _choose(
    path: Path, layout: Layout, candidates: list[Candidate], asked: str | None
) -> Candidate:
    known = [candidate.name for candidate in candidates]
    if asked is not None:
        matching = [candidate for candidate in candidates if _matches(candidate.name, asked)]
        if len(matching) != 1:
            shown = ', '.join(known[:12]) + (', ...' if len(known) > 12 else '')
            raise UsageError(f'{path}: no single sequence {asked!r}; it holds {shown}')
        return matching[0]
    if len(candidates) > 1 and not layout.traits.frame_set:
        raise AmbiguousSequenceError(path, f'--sequence {known[0]}', known)
    return candidates[0]


def _matches(name: str, asked: str) -> bool:
    if name == asked:
        return True
    drive = names.RAW_DRIVE.fullmatch(name)
    short = drive[1] if drive else name
    return short.isdecimal() and asked.isdecimal() and int(short) == int(asked)


def _subfolders(path: Path, wanted: Callable[[Path], bool]) -> list[Path]:
    return [path / name for name in STORE.names(path) if wanted(path / name)]


def _is_drive(path: Path) -> bool:
    folders = [path / name for name in (*names.RAW_IMAGES, names.RAW_SCANS, names.RAW_OXTS)]
    return any(
        (folder / names.RAW_DATA).is_dir() or (folder / names.TIMESTAMPS).is_file()
        for folder in folders
    )


def _has_frames(path: Path) -> bool:
    """Whether the sub-folders contain images or scans named by six digits."""
    folders = [(names.SCANS, names.BIN), *((name, names.PNG) for name in names.OBJECT_IMAGES)]
    return any(
        len(STORE.list_numbered(path / folder, (suffix,), names.FRAME_DIGITS).numbers)
        for folder, suffix in folders
    )


def _has_object_text(path: Path) -> bool:
    return any(
        len(STORE.list_numbered(path / folder, (names.TXT,), names.FRAME_DIGITS).numbers)
        for folder in (names.CALIB, names.OBJECT_LABELS)
    )


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
    for folder in (names.CALIB, names.OXTS, names.TRACKING_LABELS):
        found |= {
            name.removesuffix(names.TXT)
            for name in STORE.names(split / folder)
            if name.endswith(names.TXT) and _is_sequence_name(name.removesuffix(names.TXT))
        }
    return sorted(found)


def _is_sequence_name(name: str) -> bool:
    return len(name) == names.SEQUENCE_DIGITS and name.isdecimal()
