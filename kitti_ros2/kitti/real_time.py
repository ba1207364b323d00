# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""True stamps of the frames of an object set, from the time stamp files of their raw drives.

A scan has the stamp of velodyne_points of its drive, an image that of its camera, labels and
calibration that of the scan: the same as in a bag of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..model.errors import BadFileError, describe_error
from ..model.recording import FrameOrigin
from ..model.stamps import LAST_NS
from ..model.streams import Stream
from ..model.text import format_count, some_of
from . import names
from .object_mapping import DriveFrame
from .stamps_file import parse_timestamps
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from .object_mapping import ObjectMapping
    from .text_file import Lines

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
        mapping: Of the object frames.
        raw: The folder of the dates, or of the drives.
        numbers: The object frames.
    """

    def __init__(self, mapping: ObjectMapping, raw: Path, numbers: Iterable[int]) -> None:
        self._raw = raw
        every = {number: mapping.get(number) for number in numbers}
        self._frames = {number: frame for number, frame in every.items() if frame is not None}
        self._beyond = (mapping.beyond, [number for number, each in every.items() if each is None])
        self._folders = {drive: self._folder(drive) for drive in self._drives}
        self._reasons: dict[str, dict[str, list[int]]] = {}

    @property
    def _drives(self) -> list[str]:
        return sorted({frame.drive for frame in self._frames.values()})

    def _folder(self, drive: str) -> Path | None:
        """Return the folder of a drive; None without any time stamps."""
        places = (self._raw / DriveFrame(drive, 0).date / drive, self._raw / drive)
        files = [*_FILES.values()]
        return next((at for at in places if any(at.joinpath(*f).is_file() for f in files)), None)

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
        wanted = frozenset(numbers)
        found = {reason: sorted(wanted.intersection(of)) for reason, of in of_column.items()}
        return {reason: frames for reason, frames in found.items() if frames}

    def _column(self, name: str) -> dict[int, int]:
        """Read one column; the reasons of missing stamps are kept."""
        found: dict[int, int] = {}
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
                found[number] = stamp
                continue
            if lines is not None:
                error = lines.errors.get(frame.number)
                reason = reason if error is None else str(error)
            reasons.setdefault(reason, []).append(number)
        self._reasons[name] = reasons
        return found


def _stamps(path: Path) -> tuple[Lines[int] | None, str]:
    """Read a file of stamps; also return the reason why it has none for a frame."""
    try:
        lines = parse_timestamps(STORE.read_text(path), path)
    except (BadFileError, OSError) as error:
        return None, describe_error(error)
    return lines, f'{path}: {format_count(len(lines), "line")}'
