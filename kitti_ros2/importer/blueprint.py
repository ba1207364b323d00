# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How a recording was laid out before it became a bag: what /kitti/source/* of our own bags tell.

It gives every sample its file back: the text files of a layout map stamps to file numbers, and the
description maps streams to folders.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from ..bags.reader import open_messages
from ..errors import BadBagError
from ..kitti import names
from ..kitti.recording import NOMINAL_PERIOD_NS
from ..kitti.stamps_file import parse_times, parse_timestamps
from ..messages.source import decode_description, decode_text
from ..samples import Layout, Stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from ..bags.reader import BagMessages

RECORDING = '/kitti/source/recording'
FILES = '/kitti/source/files'
CALIBRATION = '/kitti/source/calibration'
_STRING = 'std_msgs/msg/String'
_MOST_DIGITS = 12
_MOST_FILES = 1_000_000  # of all streams: a day of frames; every one takes its memory
_SUFFIXES = (names.PNG, names.BIN, names.TXT)


_ERRORS = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)


class EarlierVersionError(BadBagError):
    """A bag of our own whose description lacks what tells every file its number."""

    def __init__(self, path: Path) -> None:
        super().__init__(
            path,
            'was made by an earlier version of to-bag, which did not tell the files their numbers',
            'a bag of this version: make it again with to-bag, or give --layout to go by a plan',
        )


@dataclass(frozen=True)
class Folder:
    """Where a stream's numbered files are.

    Attributes:
        path: Relative to the recording's root.
        digits: How many digits the names have.
        suffix: Their suffix.
        numbers: Those that were there, ascending.
    """

    path: PurePosixPath
    digits: int
    suffix: str
    numbers: tuple[int, ...]

    def file(self, number: int) -> PurePosixPath:
        """The path of the file with a number."""
        return self.path / names.file_name(number, self.digits, self.suffix)


@dataclass(frozen=True)
class Blueprint:
    """The layout of one recording.

    Attributes:
        layout: Which of the four.
        name: Drive, sequence or split.
        epoch_ns: Where time begins in layouts without absolute time.
        folders: By stream.
        texts: Whole text files by path relative to the recording's root, calibration apart.
        calibrations: Calibration files, in the order of their frames.
    """

    layout: Layout
    name: str
    epoch_ns: int
    folders: Mapping[Stream, Folder]
    texts: Mapping[PurePosixPath, str]
    calibrations: Mapping[PurePosixPath, str]

    @property
    def root(self) -> PurePosixPath:
        """Where the recording's root is in a data set: raw drives lie in the folder of their date.

        Source: readme.txt of the raw devkit; pykitti expects it so.
        """
        drive = self.layout is Layout.RAW and names.RAW_DRIVE.fullmatch(self.name)
        return PurePosixPath(self.name[: len('2011_09_26')] if drive else '')

    @property
    def files(self) -> int:
        """How many numbered files there were."""
        return sum(len(folder.numbers) for folder in self.folders.values())

    def numbers_by_stamp(self, stream: Stream) -> dict[int, list[int]] | None:
        """Stamp to the file numbers of a stream that have it; None where no file tells."""
        numbers = self.folders[stream].numbers
        stamps = self._stamps(stream)
        if stamps is None:
            return None
        found: dict[int, list[int]] = {}
        for number in numbers:
            if number in stamps:
                found.setdefault(stamps[number], []).append(number)
        return found

    def _stamps(self, stream: Stream) -> Mapping[int, int] | None:
        numbers = self.folders[stream].numbers
        nominal = {number: self.epoch_ns + number * NOMINAL_PERIOD_NS for number in numbers}
        if self.layout is Layout.RAW:
            folders = [folder.path.parent / names.TIMESTAMPS for folder in self.folders.values()]
            if not any(path in self.texts for path in folders):
                return nominal
            path = self.folders[stream].path.parent / names.TIMESTAMPS
            if path not in self.texts:
                return None
            return parse_timestamps(self.texts[path], str(path)).sound()
        if self.layout is Layout.ODOMETRY:
            path = self.folders[stream].path.parent / names.TIMES
            if path in self.texts:
                offsets = parse_times(self.texts[path], str(path)).sound()
                return {line: self.epoch_ns + offset for line, offset in offsets.items()}
        return nominal


def find_blueprint(path: Path) -> Blueprint | None:
    """How the recording in a bag was laid out, None where the bag does not tell.

    Raises:
        BadBagError: It is no bag, what it tells cannot be meant, or it names files outside of its
            root.
    """
    with open_messages(path, {RECORDING, FILES, CALIBRATION}) as messages:
        if RECORDING not in {topic for topic, _ in messages.channels}:
            return None
        return _read(messages, path)


def _read(messages: BagMessages, path: Path) -> Blueprint | None:
    values: dict[str, Any] | None = None
    texts: dict[PurePosixPath, str] = {}
    calibrations: dict[PurePosixPath, str] = {}
    kept = {FILES: texts, CALIBRATION: calibrations}
    for message in messages:
        if message.msgtype != _STRING:
            continue
        text: Any = messages.typestore.deserialize_cdr(message.data, _STRING)
        if message.topic == RECORDING:
            values = _description(text, path)
        elif message.topic in kept:
            file = decode_text(text)
            kept[message.topic][inside(file.name, path)] = file.text
    if values is None:
        return None
    try:
        if any('numbers' not in entry for entry in values['files'].values()):
            raise EarlierVersionError(path)
        folders = {Stream(name): _folder(entry, path) for name, entry in values['files'].items()}
        if sum(len(folder.numbers) for folder in folders.values()) > _MOST_FILES:
            raise ValueError(f'more than {_MOST_FILES} files')
        return Blueprint(
            Layout(values['layout']),
            str(values['name']),
            int(values['epoch_ns']),
            folders,
            texts,
            calibrations,
        )
    except _ERRORS as error:
        raise _unknown(path, error) from error


def _description(message: Any, path: Path) -> dict[str, Any]:  # noqa: ANN401 - of the bag's types
    try:
        return decode_description(message)
    except _ERRORS as error:
        raise _unknown(path, error) from error


def _unknown(path: Path, error: Exception) -> BadBagError:
    return BadBagError(
        path,
        f'{RECORDING} is not what kitti-ros2 writes ({type(error).__name__}: {error})',
        'the description of a recording; --plan-file goes by a plan instead',
    )


def _folder(entry: Mapping[str, Any], path: Path) -> Folder:
    digits, suffix = int(entry['digits']), str(entry['suffix'])
    if not 0 < digits <= _MOST_DIGITS or suffix not in _SUFFIXES:
        raise ValueError(f'files of {digits} digits and suffix {suffix!r}')
    numbers = tuple(_numbers(entry['numbers'], 10**digits))
    return Folder(inside(entry['folder'], path), digits, suffix, numbers)


def _numbers(spans: Iterable[tuple[int, int]], limit: int) -> Iterable[int]:
    least = 0
    for first, last in spans:
        if not least <= int(first) <= int(last) < limit or int(last) - int(first) >= _MOST_FILES:
            raise ValueError(f'file numbers {first} to {last}')
        yield from range(int(first), int(last) + 1)
        least = int(last) + 1


def inside(name: str, bag: Path) -> PurePosixPath:
    """The relative path that a bag names.

    Raises:
        BadBagError: It would lie outside of the output.
    """
    path = PurePosixPath(name)
    if path.is_absolute() or '..' in path.parts or not path.parts or '\0' in name:
        found = f'names a file {name!r}, which would lie outside of the output'
        raise BadBagError(bag, found, 'paths within the recording')
    return path
