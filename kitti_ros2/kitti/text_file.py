# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI's text files of lines: their parsing, and those of stamps, poses and GPS/IMU packets."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

import numpy as np

from ..model.errors import BadFileError
from ..model.samples import OxtsPacket
from ..model.streams import LAST_NS, format_seconds, format_stamp, parse_seconds, parse_stamp
from .store import STORE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Container, Iterable, Sequence
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import TextFile
    from ..options.read import ImuStamps
    from .store import Listing


# Parsing of KITTI's line-based text files: an invalid line becomes an error with its number.

T = TypeVar('T')

_MOST_INVALID = 1000
"""A file with more invalid lines is another kind of file, and an error costs 700 times a line."""

BOM = '\ufeff'
"""The byte order mark that some editors write at the beginning of a file."""


@dataclass(frozen=True)
class Lines(Generic[T]):
    """One value a line; None and an error for an invalid line.

    Attributes:
        values: By line, from 0.
        errors: By line, for the invalid ones.
    """

    values: list[T | None]
    errors: dict[int, BadFileError]

    def __len__(self) -> int:
        return len(self.values)

    def rows(self) -> dict[int, T | BadFileError]:
        """Return what each line is, by line."""
        rows: dict[int, T | BadFileError] = {**self.sound(), **self.errors}
        return dict(sorted(rows.items()))

    def sound(self) -> dict[int, T]:
        """Return the values of the valid lines, by line."""
        return {line: value for line, value in enumerate(self.values) if value is not None}


def parse_lines(text: str, path: Path | str, expected: str, parse: Callable[[str], T]) -> Lines[T]:
    """Parse each line of a text; a byte order mark, and blank lines at the end, are ignored.

    Args:
        text: The file's content.
        path: For the errors.
        expected: The expected content of a line, for the errors.
        parse: Raises ValueError, with what was found, on an invalid line.

    Raises:
        BadFileError: More than a thousand lines are invalid.
    """
    values: list[T | None] = []
    errors: dict[int, BadFileError] = {}
    for index, line in enumerate(text.removeprefix(BOM).rstrip().splitlines()):
        try:
            values.append(parse(line))
        except ValueError as error:
            values.append(None)
            errors[index] = BadFileError(path, str(error), expected, line=index + 1)
            check_count(errors.values(), path, expected)
    return Lines(values, errors)


def check_columns(
    lines: Iterable[tuple[int, str]], counts: Container[int], path: Path | str, expected: str
) -> None:
    """Refuse a file of another kind, before its lines are parsed.

    Args:
        lines: The number of each, from 1, and its text.
        counts: How many columns a line may have.
        path: For the error.
        expected: The expected content of a line, for the error.

    Raises:
        BadFileError: More than a thousand have another number of columns.
    """
    errors: list[BadFileError] = []
    for number, line in lines:
        count = len(line.split())
        if count not in counts:
            errors.append(BadFileError(path, f'{count} columns', expected, line=number))
            check_count(errors, path, expected)


def check_count(errors: Collection[BadFileError], path: Path | str, expected: str) -> None:
    """Refuse a file with too many invalid lines.

    Raises:
        BadFileError: There are more than a thousand.
    """
    if len(errors) > _MOST_INVALID:
        first = next(iter(errors)).line
        fault = f'this and {_MOST_INVALID} more lines, maybe all, are invalid; the file is not read'
        raise BadFileError(path, fault, expected, line=first)


def parse_numbers(words: list[str], count: int) -> list[float]:
    """Parse words into finite floats.

    Raises:
        ValueError: Their count is different, or one is no finite number.
    """
    if len(words) != count:
        raise ValueError(f'{len(words)} values')
    numbers = []
    for word in words:
        try:
            number = float(word)
        except ValueError:
            raise ValueError(f'{word!r} is no number') from None
        if not math.isfinite(number):
            raise ValueError(f'{word!r} is no finite number')
        numbers.append(number)
    return numbers


# Time stamp files: timestamps*.txt (raw) and times.txt (odometry); line n is file number n.
#
# Raw: ``2011-09-26 13:02:25.951199337``, taken as UTC, nine digits. Odometry: seconds from the
# start of the sequence, ``1.037359e-01``. Source: readme.txt of the raw and odometry devkits.

_AS_IN_KITTI = re.compile(r'((19|20)\d\d-\d\d-\d\d \d\d:\d\d:\d\d\.\d{9}\n)+', re.ASCII)


def parse_timestamps(text: str, path: Path | str) -> Lines[int]:
    """Parse a timestamps.txt: nanoseconds by line."""
    stamps = _parse_regular(text)  # ten times as fast as line by line, in every drive of KITTI
    if stamps is not None:
        return Lines(stamps, {})
    return parse_lines(text, path, 'YYYY-MM-DD HH:MM:SS.nnnnnnnnn', parse_stamp)


def _parse_regular(text: str) -> list[int | None] | None:
    """Parse a text whose lines all have KITTI's form; None if one has another or is invalid."""
    if not _AS_IN_KITTI.fullmatch(text):
        return None
    try:
        stamps_ns = np.array(text.splitlines(), 'datetime64[ns]').astype(np.int64)
    except ValueError:
        return None
    valid = stamps_ns.min() >= 0 and stamps_ns.max() <= LAST_NS
    return stamps_ns.tolist() if valid else None


def format_timestamps(stamps_ns: Iterable[int]) -> str:
    """Format a timestamps.txt; the inverse of parse_timestamps."""
    return ''.join(f'{format_stamp(stamp)}\n' for stamp in stamps_ns)


def parse_times(text: str, path: Path | str) -> Lines[int]:
    """Parse a times.txt: nanoseconds from the start, by line."""
    return parse_lines(text, path, 'a number of seconds', parse_seconds)


def format_times(offsets_ns: Iterable[int]) -> str:
    """Format a times.txt; the inverse of parse_times to its seven digits."""
    return ''.join(f'{format_seconds(offset)}\n' for offset in offsets_ns)


# Odometry ground truth, poses/NN.txt: line n is the pose of frame n.
#
# Twelve numbers a line, the row-major (3, 4) matrix first_cam0_T_cam0 of the rectified camera 0 in
# its own first frame. Source: readme.txt of the odometry devkit.


def parse_poses(text: str, path: Path | str) -> Lines[Float64Array]:
    """Parse a poses file: a (3, 4) float64 matrix a line."""
    return parse_lines(text, path, 'twelve numbers, a 3x4 pose matrix', _parse_pose)


def format_poses(matrices: Iterable[Float64Array]) -> str:
    """Format a poses file, six decimals of mantissa as the benchmark's own."""
    return ''.join(
        ' '.join(f'{value:.6e}' for value in matrix[:3].ravel()) + '\n' for matrix in matrices
    )


def _parse_pose(line: str) -> Float64Array:
    return np.array(parse_numbers(line.split(), 12)).reshape(3, 4)


class NumberedPoses(NamedTuple):
    """A file of poses.

    Attributes:
        lines: A (3, 4) float64 matrix a line.
        numbers: The frame of each line; of an invalid one any number.
    """

    lines: Lines[Float64Array]
    numbers: Sequence[int]


def parse_odometry_poses(text: str, path: Path | str) -> NumberedPoses:
    """Parse a poses file whose line n is frame n."""
    lines = parse_poses(text, path)
    return NumberedPoses(lines, range(len(lines)))


# GPS/IMU packets: one a file (raw) or one a line (tracking), 30 columns.
#
# Columns: lat lon alt roll pitch yaw vn ve vf vl vu ax ay az af al au wx wy wz wf wl wu
# pos_accuracy vel_accuracy navstat numsats posmode velmode orimode; for units and axes see
# samples.OxtsPacket. The dataset's own dataformat.txt lists ay twice: the second is az.

COLUMNS: tuple[str, ...] = tuple(
    field.name for field in fields(OxtsPacket) if field.name != 'source'
)
_FLOATS = COLUMNS.index('navstat')
_EXPECTED = f'the {len(COLUMNS)} numbers of an oxts packet'
# Degrees, metres, radians, metres, m/s: no real packet comes near.
_LIMITS = {
    'lat': 89.9,
    'lon': 360.0,
    'alt': 1e5,
    **dict.fromkeys(('roll', 'pitch', 'yaw'), 6.3),
    **dict.fromkeys(('pos_accuracy', 'vel_accuracy'), 1e9),
}


def parse_packet(
    text: str, path: Path | str, line: int = 1, source: TextFile | None = None
) -> OxtsPacket:
    """Parse a packet.

    Args:
        text: The line.
        path: For the errors.
        line: For the errors, from 1.
        source: Kept in the packet.

    Raises:
        BadFileError: Not 30 values, or one that is no finite number.
    """
    try:
        values = parse_numbers(text.split(), len(COLUMNS))
        _check_ranges(values)
    except ValueError as error:
        raise BadFileError(path, str(error), _EXPECTED, line=line) from None
    states = (int(value) for value in values[_FLOATS:])
    return OxtsPacket(*values[:_FLOATS], *states, source=source)  # type: ignore[arg-type, misc]


def packet_lines(text: str, path: Path | str) -> list[str]:
    """Return the lines of a file of packets with their ends, blank ones at its end left out.

    Raises:
        BadFileError: More than a thousand do not have 30 values.
    """
    lines = text.splitlines(keepends=True)
    while lines and not lines[-1].strip():
        lines.pop()
    check_columns(enumerate(lines, 1), (len(COLUMNS),), path, _EXPECTED)
    return lines


def _check_ranges(values: list[float]) -> None:
    """Check that a position is on earth, and that accuracies have squares.

    Mercator would make NaN of another position.

    Raises:
        ValueError: A column is out of range.
    """
    for name, value in zip(COLUMNS, values, strict=True):
        if abs(value) > _LIMITS.get(name, math.inf):
            raise ValueError(f'{name} is {value:g}')


def format_packet(packet: OxtsPacket) -> str:
    """Format the line of a packet without its end, 15 significant digits as the dataset's own.

    Those that KITTI interpolated have no modes, and 14 decimals in all columns.
    """
    values = [getattr(packet, name) for name in COLUMNS]
    if packet.numsats > 0 and {packet.posmode, packet.velmode, packet.orimode} == {-1}:
        return ' '.join(f'{value:.14f}' for value in values)
    return ' '.join(
        [f'{value:.15g}' for value in values[:_FLOATS]]
        + [f'{value:d}' for value in values[_FLOATS:]]
    )


# The files of an unsynchronised drive's packets.


@dataclass(frozen=True)
class PacketFiles:
    """The files of an unsynchronised drive's packets.

    Attributes:
        drive: Its name.
        listing: The files.
        stamps: The kind of stamps that the packets have in the recording.
    """

    drive: str
    listing: Listing
    stamps: ImuStamps

    def path(self, number: int) -> Path:
        """Return the file of a packet."""
        return self.listing.path(number)

    def packet(self, number: int) -> OxtsPacket:
        """Read a packet; it has no source, since it is no file of the recording."""
        path = self.path(number)
        return parse_packet(STORE.read_text(path), path)

    def text(self, number: int) -> str | None:
        """Read the text of a packet, None if it cannot be read."""
        try:
            return STORE.read_text(self.path(number))
        except (BadFileError, OSError):
            return None

    def describe(self) -> dict[str, str]:
        """Return their part of the recording's description."""
        return {'drive': self.drive, 'stamps': self.stamps.value}
