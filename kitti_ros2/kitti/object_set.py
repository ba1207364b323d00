# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Object sets: the drives that their frames are from, true stamps, and the journal of an append."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

from ..kitti import names
from ..model.errors import BadFileError, UsageError, describe_error, either, format_count, some_of
from ..model.recording import FrameOrigin
from ..model.streams import LAST_NS, Stream
from .store import STORE
from .text_file import parse_timestamps

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from .text_file import Lines


# The object devkit's mapping: the raw drive and file number of each object training frame.
#
# train_mapping.txt: one line a drive frame, ``2011_09_26 2011_09_26_drive_0005_sync 0000000109``.
# train_rand.txt: line numbers of that file, from 1, separated by commas, a permutation: value k
# (from 0) is the line of object frame k. Both have 7481 entries; the testing frames have no
# mapping. Source: readme.txt of the object devkit.

MAPPING = 'train_mapping.txt'
RAND = 'train_rand.txt'

_LINE = re.compile(r'(\d{4}_\d{2}_\d{2}) (\1_drive_\d{4}_(?:sync|extract)) (\d{1,10})', re.ASCII)
_BELOW = ('', 'mapping', 'object/mapping', 'devkit/mapping', 'devkit/object/mapping',
          'devkit_object/mapping', 'devkit_object/devkit/mapping')  # fmt: skip
"""Folders of the mapping within a folder that a user names, or beside or in the object set."""


class DriveFrame(NamedTuple):
    """A file number of a raw drive.

    Attributes:
        drive: Name, such as 2011_09_26_drive_0005_sync.
        number: The file number.
    """

    drive: str
    number: int

    @property
    def date(self) -> str:
        """The folder that holds the drive."""
        return self.drive[: len('2011_09_26')]


@dataclass(frozen=True)
class ObjectMapping:
    """The drive frames of the object training frames.

    Attributes:
        folder: The folder of both files.
        frames: By object frame.
    """

    folder: Path
    frames: tuple[DriveFrame, ...]

    def get(self, number: int) -> DriveFrame | None:
        """Return the drive frame of an object frame; None beyond the mapping."""
        return self.frames[number] if number < len(self.frames) else None

    @property
    def beyond(self) -> str:
        """The reason why a frame has no drive."""
        return f'{self.folder / RAND}: {len(self.frames)} numbers, so no drive'


def find_mapping(root: Path, devkit: Path | None = None) -> ObjectMapping:
    """Read the mapping in a given folder, or else in, beside or above an object set.

    Args:
        root: The folder of training and testing, absolute.
        devkit: A folder of the devkit, or of the mapping itself.

    Raises:
        UsageError: There is none.
        BadFileError: It is invalid.
        OSError: It cannot be read.
    """
    bases = (root, root.parent) if devkit is None else (devkit,)
    for folder in (base / below for base in bases for below in _BELOW):
        if (folder / MAPPING).is_file() and (folder / RAND).is_file():
            return read_mapping(folder)
    where = f'in or beside {root}' if devkit is None else f'in {devkit}'
    raise UsageError(
        f'no {MAPPING} and {RAND} {where}; they are in devkit_object.zip of KITTI:'
        f' give their folder with --mapping'
    )


def read_mapping(folder: Path) -> ObjectMapping:
    """Read the mapping in a folder.

    Raises:
        BadFileError: A line is invalid, or the numbers are no permutation of the lines.
        OSError: A file cannot be read.
    """
    lines = parse_mapping(STORE.read_text(folder / MAPPING), folder / MAPPING)
    order = parse_rand(STORE.read_text(folder / RAND), folder / RAND, len(lines))
    return ObjectMapping(folder, tuple(lines[line - 1] for line in order))


def parse_mapping(text: str, path: Path) -> list[DriveFrame]:
    """Parse train_mapping.txt.

    Raises:
        BadFileError: A line is invalid or repeated, or there is none.
    """
    line_numbers: dict[DriveFrame, int] = {}
    for line_number, line in enumerate(text.rstrip().splitlines(), 1):
        match = _LINE.fullmatch(line.strip())
        if match is None:
            expected = 'date, drive and number such as 2011_09_26 2011_09_26_drive_0005_sync 12'
            raise BadFileError(path, f'{line.strip()!r}', expected, line=line_number)
        frame = DriveFrame(match[2], int(match[3]))
        if frame in line_numbers:
            what = f'{frame.drive} {frame.number} is in line {line_numbers[frame]} as well'
            raise BadFileError(path, what, 'each frame once', line=line_number)
        line_numbers[frame] = line_number
    if not line_numbers:
        raise BadFileError(path, 'no line', 'one line for each object training frame')
    return [*line_numbers]


def parse_rand(text: str, path: Path, lines: int) -> list[int]:
    """Parse train_rand.txt: line numbers of the mapping, from 1.

    Args:
        text: Its content.
        path: For the errors.
        lines: Number of lines of train_mapping.txt.

    Raises:
        BadFileError: It is no permutation of the line numbers.
    """
    expected = f'each line of {MAPPING} once, 1 to {lines}'
    order: dict[int, int] = {}
    words = text.replace(',', ' ').split()
    for index, word in enumerate(words, 1):
        number = int(word) if word.isascii() and word.isdecimal() and len(word) < 10 else 0
        if not 1 <= number <= lines:
            raise BadFileError(path, f'number {index} is {word!r}', expected)
        if number in order:
            what = f'numbers {order[number]} and {index} are both {number}'
            raise BadFileError(path, what, expected)
        order[number] = index
    if len(order) != lines:
        raise BadFileError(path, format_count(len(order), 'number'), expected)
    return [*order]


def find_raw_root(root: Path, raw: Path | None = None) -> Path:
    """Return the folder of the raw drives: a given one, or else beside an object set.

    Args:
        root: The folder of training and testing, absolute.
        raw: A folder of dates, or of the drives themselves.

    Raises:
        UsageError: There is none.
    """
    if raw is not None:
        if not raw.is_dir():
            raise UsageError(
                f'{raw}: no such folder; --raw-drives takes the folder of the raw drives'
            )
        return raw
    for folder in (root / 'raw', root.parent / 'raw', root.parent / 'raw_data', root.parent):
        if any(names.RAW_DATE.fullmatch(name) for name in STORE.names(folder)):
            return folder
    searched = either([f'{root.parent}/raw', f'{root.parent}/raw_data'])
    raise UsageError(
        f'no raw drives beside {root} (in {searched}); give their folder with --raw-drives,'
        f' of their archives {names.TIMESTAMPS} in each stream is enough'
    )


# True stamps of the frames of an object set, from the time stamp files of their raw drives.
#
# A scan has the stamp of velodyne_points of its drive, an image that of its camera, labels and
# calibration that of the scan: the same as in a bag of the drive.

REAL_TIME = 'real_time'
"""The key of the times in the description of a recording."""
STARTS = 'start'
ENDS = 'end'
_FILES = {
    Stream.SCAN.value: (names.RAW_SCANS, names.TIMESTAMPS),
    STARTS: (names.RAW_SCANS, names.TIMESTAMPS_START),
    ENDS: (names.RAW_SCANS, names.TIMESTAMPS_END),
} | {f'image_{index}': (folder, names.TIMESTAMPS) for index, folder in enumerate(names.RAW_IMAGES)}
"""By name of a column of stamps: folder and file of a raw drive."""

_MOST = 10**names.RAW_DIGITS - 1
"""The highest file number."""

_OF_FRAME = (Stream.SCAN.value, Stream.IMAGE_2.value)
"""The columns that have the stamp of a frame, the first that has one."""


@dataclass(frozen=True)
class RealTimes:
    """The drive frames and the true stamps of the frames of an object set.

    Attributes:
        frames: The drive's frame, by object frame.
        columns: Nanoseconds since 1970 UTC by object frame, by name of a column: scan, start and
            end of its turn, image_0 to image_3.
    """

    frames: Mapping[int, DriveFrame]
    columns: Mapping[str, Mapping[int, int]]

    @cached_property
    def origins(self) -> dict[int, FrameOrigin]:
        """The origin of each frame that has a stamp."""
        stamps = self._frame_stamps
        return {
            number: FrameOrigin(frame.drive, frame.number, stamps[number])
            for number, frame in self.frames.items()
            if number in stamps
        }

    @cached_property
    def _frame_stamps(self) -> Mapping[int, int]:
        first, other = (self.columns.get(name, {}) for name in _OF_FRAME)
        return {**other, **first}

    def stamps(self, stream: Stream) -> Mapping[int, int]:
        """Return the stamps of a stream, nanoseconds by object frame."""
        if stream is Stream.SCAN or stream.camera is not None:
            return self.columns.get(stream.value, {})
        return self._frame_stamps

    def turn_stamps(self, column: str) -> Mapping[int, int]:
        """Return the starts or ends of the scanner's turns, nanoseconds by object frame."""
        return self.columns.get(column, {})


def describe_times(times: RealTimes) -> dict[str, Any]:
    """Return the times as values of JSON: rows of object frame, drive frame and stamps by drive."""
    columns = sorted(times.columns)
    drives: dict[str, list[list[int | None]]] = {}
    for number, frame in sorted(times.frames.items()):
        stamps = [times.columns[name].get(number) for name in columns]
        drives.setdefault(frame.drive, []).append([number, frame.number, *stamps])
    return {'columns': columns, 'drives': drives}


def parse_times_of(values: Mapping[str, Any]) -> RealTimes:
    """Parse the values of describe_times, which are not trusted.

    Raises:
        ValueError, TypeError, KeyError, AttributeError: They are invalid.
    """
    frames: dict[int, DriveFrame] = {}
    columns: dict[str, dict[int, int]] = {str(name): {} for name in values['columns']}
    for drive, rows in values['drives'].items():
        if not names.RAW_DRIVE.fullmatch(drive):
            raise ValueError(f'a drive {drive!r}')
        for number, own, *stamps in rows:
            frames[_within(number, _MOST)] = DriveFrame(drive, _within(own, _MOST))
            for column, stamp in zip(columns.values(), stamps, strict=True):
                if stamp is not None:
                    column[number] = _within(stamp, LAST_NS)
    return RealTimes(frames, columns)


def _within(value: object, highest: int) -> int:
    if not isinstance(value, int) or not 0 <= value <= highest:
        raise ValueError(f'a number {value!r}')
    return value


class DriveStamps:
    """The true stamps of object frames, read from the raw drives; each file is read once.

    Args:
        mapping: Mapping of the object frames.
        raw: The folder of the dates, or of the drives.
        numbers: The object frames.
    """

    def __init__(self, mapping: ObjectMapping, raw: Path, numbers: Iterable[int]) -> None:
        self._raw = raw
        every = {number: mapping.get(number) for number in numbers}
        self._frames = {number: frame for number, frame in every.items() if frame is not None}
        self._beyond = (mapping.beyond, [n for n, frame in every.items() if frame is None])
        self._folders = {drive: self._folder(drive) for drive in self._drives}
        self._reasons: dict[str, dict[str, list[int]]] = {}

    @property
    def _drives(self) -> list[str]:
        return sorted({frame.drive for frame in self._frames.values()})

    def _folder(self, drive: str) -> Path | None:
        """Return the folder of a drive; None without any time stamps."""
        folders = (self._raw / DriveFrame(drive, 0).date / drive, self._raw / drive)
        files = [*_FILES.values()]
        return next((at for at in folders if any(at.joinpath(*f).is_file() for f in files)), None)

    @cached_property
    def _absent(self) -> str:
        drives = [drive for drive, folder in self._folders.items() if folder is None]
        count = format_count(len(drives), 'drive')
        return f'{self._raw}: no time stamps of {count} ({some_of(drives)})'

    def read(self, streams: Sequence[Stream]) -> RealTimes:
        """Read the stamps that some streams need."""
        needed = {*_OF_FRAME, STARTS, ENDS, *(stream.value for stream in streams)}
        columns = {name: self._column(name) for name in _FILES if name in needed}
        return RealTimes(self._frames, columns)

    def reasons_of(self, stream: Stream, numbers: Sequence[int]) -> dict[str, list[int]]:
        """Return the frames of a stream without a stamp, of some numbers, by reason."""
        column = _OF_FRAME[0] if stream.camera is None else stream.value
        if column not in _FILES:
            return {f'{stream.value}: no camera of the raw drives': [*numbers]}
        of_column = self._reasons[column]
        requested = frozenset(numbers)
        by_reason = {reason: sorted(requested.intersection(of)) for reason, of in of_column.items()}
        return {reason: frames for reason, frames in by_reason.items() if frames}

    def _column(self, name: str) -> dict[int, int]:
        """Read one column; the reasons of missing stamps are kept."""
        stamps: dict[int, int] = {}
        beyond, numbers = self._beyond
        reasons = {beyond: [*numbers]} if numbers else {}
        files: dict[str, tuple[Lines[int] | None, str]] = {}
        for number, frame in sorted(self._frames.items()):
            folder = self._folders[frame.drive]
            if folder is None:
                reasons.setdefault(self._absent, []).append(number)
                continue
            if frame.drive not in files:
                files[frame.drive] = _stamps(folder.joinpath(*_FILES[name]))
            lines, reason = files[frame.drive]
            values = [] if lines is None else lines.values
            stamp = values[frame.number] if frame.number < len(values) else None
            if stamp is not None:
                stamps[number] = stamp
                continue
            if lines is not None:
                error = lines.errors.get(frame.number)
                reason = reason if error is None else str(error)
            reasons.setdefault(reason, []).append(number)
        self._reasons[name] = reasons
        return stamps


def _stamps(path: Path) -> tuple[Lines[int] | None, str]:
    """Read a file of stamps; also return the reason why it has none for a frame."""
    try:
        lines = parse_timestamps(STORE.read_text(path), path)
    except (BadFileError, OSError) as error:
        return None, describe_error(error)
    return lines, f'{path}: {format_count(len(lines), "line")}'


# The journal of an append to an object set; with it an incomplete append is undone.
#
# While frames are appended, the set holds the folder ``.to-kitti-append``:
#
# ==================
# ================================================================================ entry content
# ==================
# ================================================================================ ``content/`` the
# new files that are not moved yet, at the paths that they get in the set ``before/`` the lists of
# frames (ImageSets) that are continued, as they were ``journal.json`` present while files are
# moved; the next reader or writer undoes the append ``committed.json`` the same content, once every
# file is in its place ==================
# ================================================================================
#
# A file of the journal is in the set if, and only if, it is missing in ``content/``.

FOLDER = '.to-kitti-append'
CONTENT = 'content'
BEFORE = 'before'
JOURNAL = 'journal.json'
COMMITTED = 'committed.json'

_VERSION = 1


@dataclass(frozen=True)
class AppendJournal:
    """The files that an append adds to a set; all paths are relative to the set's folder.

    Attributes:
        split: training or testing.
        files: The files that the set did not have, in the order of moving: those of frames, then
            lists of frames.
        lists: The lists of frames that are continued, moved after all files.
        folders: Folders that the set did not have, parents first.
    """

    split: str
    files: tuple[PurePosixPath, ...]
    lists: tuple[PurePosixPath, ...]
    folders: tuple[PurePosixPath, ...]

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the numbers of the frames, ascending."""
        stems = {path.stem for path in self.files if path.parts[0] == self.split}
        return tuple(sorted(int(stem) for stem in stems if stem.isdecimal()))


def format_journal(journal: AppendJournal) -> str:
    """Format a journal; the inverse of parse_journal."""
    paths = {
        name: [str(path) for path in getattr(journal, name)]
        for name in ('files', 'lists', 'folders')
    }
    return json.dumps({'version': _VERSION, 'split': journal.split, **paths}, indent=0) + '\n'


def parse_journal(text: str, path: Path | str) -> AppendJournal:
    """Parse a journal.

    Raises:
        BadFileError: The text is no journal, or contains a path that an append does not write.
    """
    try:
        return _parse_values(json.loads(text))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        problem = ' '.join(f'{type(error).__name__}: {error}'.split())[:200]
        remedy = 'move it away, and look for files of incomplete frames'
        raise BadFileError(path, problem, 'the journal of an append', remedy=remedy) from None


def _parse_values(values: Any) -> AppendJournal:  # noqa: ANN401 - of JSON
    if values['version'] != _VERSION or values['split'] not in names.SPLITS:
        raise ValueError(f'version {values["version"]!r}, split {values["split"]!r}')
    split = values['split']
    return AppendJournal(
        split,
        tuple(_path(item, split, names.IMAGE_SETS) for item in values['files']),
        tuple(_path(item, names.IMAGE_SETS) for item in values['lists']),
        tuple(_path(item, split, names.IMAGE_SETS) for item in values['folders']),
    )


def find_journal(root: Path) -> AppendJournal | None:
    """Find the journal of an incomplete append to a set, None without one.

    Raises:
        BadFileError: The journal is invalid.
        OSError: It cannot be read.
    """
    path = root / FOLDER / JOURNAL
    try:
        text = STORE.read_text(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return parse_journal(text, path)


def _path(item: Any, *tops: str) -> PurePosixPath:  # noqa: ANN401 - of JSON
    """Parse a path; it must be below one of the folders, as undoing deletes files there."""
    path = PurePosixPath(item)
    if path.parts[:1] not in [(top,) for top in tops] or '..' in path.parts:
        raise ValueError(f'path {item!r}')
    return path
