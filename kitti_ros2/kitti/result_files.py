# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label files by frame, and result files of a detector or tracker in the same format."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.errors import BadFileError, MissingDataError, MissingPathError, UsageError
from ..model.losses import Loss
from ..model.samples import TextFile
from ..model.streams import Stream
from ..model.text import some_of
from .label_file import frame_labels, parse_box, parse_labels
from .names import (
    CALIB,
    FRAME_DIGITS,
    OBJECT_LABELS,
    SEQUENCE_DIGITS,
    SIX_DIGITS,
    SPLITS,
    TRACKING_LABELS,
    TXT,
    WAYMO_LABELS,
    FileNames,
    number_of,
    split_name,
)
from .store import STORE
from .track_file import TrackFile

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.samples import FrameLabels

_DATA = 'data'
"""The sub-folder for result files of the devkits' evaluation and OpenPCDet."""
_NAMED = f'{"0" * FRAME_DIGITS}{TXT}'
_MOST_FOLDERS = 200
_MOST_LOOKS = 20
_OF_DATA_SETS = frozenset({CALIB, OBJECT_LABELS, WAYMO_LABELS, TRACKING_LABELS})


class ResultFiles:
    """The results, or the labels, of one recording.

    Args:
        path: A folder with a file for each frame (like label_2), directly or in its data/; or a
            tracker's file (lines of all frames, like label_02).
        stream: For losses.
        frames: How the frames of the labels are named; None: by numbers, or in the order of names.

    Attributes:
        root: The folder of the files, or the tracker's file.
        complete: Whether frames that are not in numbers have no objects, as in a tracker's file.
        numbers: The frames, ascending; of a folder those with a file.
        losses: Files whose name is no frame's; lines of a tracker's file without one.
        frames: How the frames are named.

    Raises:
        UsageError: The path contains no result file; the message says what to give.
        BadFileError: A tracker's file is no text, or no line begins with a frame number.
        OSError: It cannot be read.
    """

    def __init__(
        self,
        path: Path,
        stream: str = Stream.PREDICTIONS.value,
        frames: FileNames | None = None,
    ) -> None:
        if not path.exists():
            raise MissingPathError(path)
        self.complete = path.is_file()
        self.root = path if self.complete else _folder_of(path, frames)
        self._stream = stream
        self._absent = f'{self.root}: no result file for frames {{}}'
        self._tracks = _read_tracks(path) if self.complete else None
        if self._tracks is None:
            self.frames = frames or STORE.find_frames({self.root: (TXT,)}, FRAME_DIGITS)
            self._listing = STORE.list_numbered(self.root, (TXT,), FRAME_DIGITS, self.frames)
            self.numbers: tuple[int, ...] = tuple(self._listing.numbers.tolist())
            self.losses = self._misnamed()
        else:
            self.frames = frames or SIX_DIGITS
            self.numbers = tuple(sorted(self._tracks.rows))
            self.losses = tuple(Loss(stream, 1, str(error)) for error in self._tracks.errors)
        self._known = frozenset(self.numbers)

    def _misnamed(self) -> tuple[Loss, ...]:
        """Return the files of no frame, and those of a frame that has another."""
        listing = self._listing
        texts = [name for name in listing.strays if _is_text(name)]
        of_none = [name for name in texts if self.frames.stems or number_text(name)]
        doubles = [name for names in listing.doubles.values() for name in names]
        reasons = {
            f'{self.root}: {some_of(of_none)}: no frame has this name': of_none,
            f'{self.root}: {some_of(doubles)} not read; their frames have other files': doubles,
        }
        return tuple(
            Loss(self._stream, len(names), text.replace('{', '(').replace('}', ')'))
            for text, names in reasons.items()
            if names
        )

    def path(self, number: int) -> Path:
        """Return the file of a frame."""
        return self._listing.path(number) if self._tracks is None else self.root

    def boxes(self, number: int) -> tuple[list[Box], list[BadFileError]]:
        """Read the boxes of a frame, and an error for each invalid line; none if it has no file.

        Raises:
            BadFileError: The file is no text.
            OSError: The file cannot be read.
        """
        if self._tracks is not None:
            return self._tracks.boxes(number)
        if number not in self._known:
            return [], []
        lines = parse_labels(STORE.read_text(self.path(number)), self.path(number))
        return [*lines.sound().values()], [*lines.errors.values()]

    def read(self, number: int) -> FrameLabels:
        """Read the results of a frame; invalid lines are in its missing.

        Raises:
            MissingDataError: There is no file for it; {} in the message stands for its number.
            BadFileError: The file is no text.
            OSError: The file cannot be read.
        """
        path = self.path(number)
        if self._tracks is not None:
            return self._tracks.labels(number, path.name)
        if number not in self._known:
            raise MissingDataError(self._absent)
        text = STORE.read_text(path)
        return frame_labels(parse_labels(text, path).rows(), TextFile(path.name, text), path)

    def absent(self, numbers: Collection[int]) -> Loss | None:
        """Return the loss of the frames without a result file; a tracker's file has all frames."""
        if self.complete or self._known.issuperset(numbers):
            return None
        lost = tuple(sorted({*numbers} - self._known))
        return Loss(self._stream, len(lost), self._absent, lost)


def find_frame_files(path: Path, digits: int = FRAME_DIGITS) -> Path | None:
    """Return the folder with files named by frame: a path, or its data/; None without such files.

    The folder itself comes first.

    Args:
        path: A folder.
        digits: Of the names; SEQUENCE_DIGITS for a tracker's files.
    """
    return next((each for each in (path, path / _DATA) if _named_by(each, digits)), None)


def _named_by(folder: Path, digits: int) -> bool:
    texts = [name for name in STORE.names(folder) if _is_text(name)]
    if any(len(number_text(name)) == digits for name in texts):
        return True
    return digits == FRAME_DIGITS and _are_labels(folder, texts[:_MOST_LOOKS])


def _is_text(name: str) -> bool:
    return split_name(name)[1].lower() == TXT and not name.startswith('.')


def number_text(name: str) -> str:
    """Return the digits of a numbered file; empty for another name."""
    stem = split_name(name)[0]
    return stem if number_of(stem) is not None else ''


def _are_labels(folder: Path, texts: Sequence[str]) -> bool:
    """Whether files of other names than KITTI's hold labels of a frame each."""
    for name in texts:
        try:
            lines = STORE.read_text(folder / name).split('\n', 1)
            if lines[0].strip():
                return parse_box(lines[0]).frame is None
        except (ValueError, BadFileError, OSError):
            return False
    return False


def _folder_of(path: Path, frames: FileNames | None) -> Path:
    """Return the folder of the files of a path.

    Raises:
        UsageError: There are none.
    """
    if frames is not None and frames.stems:
        found = next((each for each in (path, path / _DATA) if _is_of(each, frames)), None)
        if found is None:
            wanted = f'expected a file like {frames.stem(0)}{TXT} for each frame'
            raise UsageError(f'{path}: holds {some_of(STORE.names(path)) or "nothing"}; {wanted}')
        return found
    found = find_frame_files(path)
    if found is None:
        raise UsageError(f'{path}: {_describe_folder(path)}')
    return found


def _is_of(folder: Path, frames: FileNames) -> bool:
    return bool(len(STORE.list_numbered(folder, (TXT,), FRAME_DIGITS, frames).numbers))


def _describe_folder(path: Path) -> str:
    """Describe a folder without files named by frame, and what to give instead."""
    entries = STORE.names(path)
    if not entries:
        return f'the folder is empty; expected a file like {_NAMED} for each frame'
    below = [path / name for name in entries[:_MOST_FOLDERS] if name not in _OF_DATA_SETS]
    found = [each for folder in below if (each := find_frame_files(folder)) is not None]
    if found:
        return f'contains no file like {_NAMED}; did you mean {some_of([*map(str, found)])}?'
    if not _OF_DATA_SETS.union(SPLITS).isdisjoint(entries):
        return f'is a folder of a KITTI data set; expected result files like {_NAMED}'
    tracks = STORE.list_numbered(path, (TXT,), SEQUENCE_DIGITS)
    first = tracks.path(int(tracks.numbers[0])) if len(tracks.numbers) else None
    hint = f'; give the file of one sequence, such as {first}' if first is not None else ''
    return f'contains no file like {_NAMED}, but {some_of(entries)}{hint}'


def _read_tracks(path: Path) -> TrackFile:
    """Read a tracker's file.

    Raises:
        BadFileError: It is no text, or has lines but no frame number.
    """
    tracks = TrackFile(STORE.read_text(path), path)
    if tracks.errors and not tracks.rows:
        expected = (
            f'17 or 18 columns, of which the first is the frame, or a folder of files like {_NAMED}'
        )
        raise BadFileError(path, 'no line begins with a frame number', expected)
    return tracks
