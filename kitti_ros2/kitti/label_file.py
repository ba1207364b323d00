# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label files of the object and tracking layouts, and results of detectors and trackers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from ..kitti import names
from ..model.boxes import DONT_CARE, Box, is_absurd
from ..model.errors import (
    BadFileError,
    Loss,
    MissingDataError,
    MissingPathError,
    UsageError,
    some_of,
)
from ..model.samples import FrameLabels, TextFile
from ..model.streams import Stream
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
from .text_file import BOM, Lines, check_columns, check_count, parse_lines, parse_numbers

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence


# Label files: label_2/NNNNNN.txt (object) and label_02/SSSS.txt (tracking), one object a line.
#
# Columns, separated by blanks (source: readme.txt of the object and tracking devkits):
#
# - tracking only: frame (file number), track id (-1 for DontCare)
# - type: a word; custom ones are legal
# - truncated: object 0..1, the part that leaves the image; tracking a level 0, 1, 2; -1 unknown
# - occluded: 0 visible, 1 partly, 2 largely, 3 unknown, -1 DontCare
# - alpha: observation angle, radians, -pi..pi; -10 for DontCare
# - left, top, right, bottom: 2D box, pixels, 0-based
# - height, width, length: metres; -1 for DontCare
# - x, y, z: the bottom face's centre in the rectified camera 0 frame, metres; -1000 for DontCare
# - rotation_y: heading about the camera's y axis, radians, -pi..pi; -10 for DontCare
# - score: detections only
#
# Object files have two decimals, tracking files six.
#
# label_all of Waymo in KITTI's format has the camera of the 2D box where results have the score,
# and maybe a name of the track behind it (source: save_label of mmdetection3d's converter, 1.1).

EXPECTED = '15 or 16 columns (object), or 17 or 18 (tracking): type, numbers, maybe a score'
EXPECTED_TRACKS = '17 or 18 columns: frame, track id, type, numbers, maybe a score'

_OBJECT_COLUMNS = 15
TRACK_COLUMNS = (17, 18)
_CAMERA = 2
_NO_BOX = (0.0, 0.0, 0.0, 0.0)
_TRACKS = 2**31  # ids of markers are int32


def parse_labels(text: str, path: Path | str) -> Lines[Box]:
    """Parse the boxes of a label file by line; an invalid line becomes an error with path and line.

    Object and tracking lines differ in their number of columns.
    """
    pure_path = PurePath(path) if isinstance(path, str) else path
    of_all = pure_path.parent.name == WAYMO_LABELS
    return parse_lines(text, path, EXPECTED, _parse_of_all if of_all else parse_box)


def _parse_of_all(line: str) -> Box:
    """Parse the box of one line of label_all; only camera 2 has 2D boxes of labels.

    Raises:
        ValueError: As parse_box.
    """
    words = line.split()
    box = parse_box(' '.join(words[:_OBJECT_COLUMNS]))
    camera = words[_OBJECT_COLUMNS] if len(words) > _OBJECT_COLUMNS else ''
    return box if camera in {'', str(_CAMERA)} else replace(box, box_2d=_NO_BOX)


def parse_track(line: str, path: Path | str, number: int) -> Box | BadFileError:
    """Return the box of a line with a frame and a track id, or what is wrong with it.

    Args:
        line: The line.
        path: For the error.
        number: Line number, from 1.
    """
    try:
        return _parse_tracked(line)
    except ValueError as error:
        return BadFileError(path, str(error), EXPECTED_TRACKS, line=number)


def frame_labels(
    rows: Mapping[int, Box | BadFileError], source: TextFile, path: Path
) -> FrameLabels:
    """Return the labels of a frame.

    Args:
        rows: By the row of its line in its file, from 0, a box or what is wrong with it.
        source: The frame's lines, verbatim.
        path: For the errors.
    """
    boxes: list[Box | None] = []
    missing = {}
    for row, box in rows.items():
        if isinstance(box, BadFileError):
            missing[str(row)] = str(box)
        elif is_absurd(box):
            problem = 'a box of height, width, length ' + ' '.join(f'{v:g}' for v in box.size_hwl)
            error = BadFileError(path, problem, 'positive sizes', line=row + 1)
            missing[str(row)] = f'{error}; it gets no marker and no 3D detection'
        boxes.append(None if isinstance(box, BadFileError) else box)
    return FrameLabels(boxes=boxes, source=source, missing=missing)


def labels_of_text(file: TextFile) -> FrameLabels:
    """Return the labels of a frame from the text of its file."""
    return frame_labels(parse_labels(file.text, file.name).rows(), file, Path(file.name))


def parse_box(line: str) -> Box:
    """Parse the box of one line.

    Raises:
        ValueError: The line is no label; the message contains what was found instead.
    """
    words = line.split()
    frame: int | None = None
    track_id: int | None = None
    if len(words) in TRACK_COLUMNS:
        frame, track_id = _parse_integer(words[0]), _parse_integer(words[1])
        if abs(track_id) >= _TRACKS:
            raise ValueError(f'track id {words[1]}')
        words = words[2:]
    if len(words) not in {_OBJECT_COLUMNS, _OBJECT_COLUMNS + 1}:
        raise ValueError(f'{len(line.split())} columns')
    truncated, _, alpha, *rest = parse_numbers(words[1:], len(words) - 1)
    left, top, right, bottom, height, width, length, x, y, z, rotation_y = rest[:11]
    return Box(
        class_name=words[0],
        truncated=truncated,
        occluded=_parse_integer(words[2]),
        alpha=alpha,
        box_2d=(left, top, right, bottom),
        size_hwl=(height, width, length),
        location=(x, y, z),
        rotation_y=rotation_y,
        score=rest[11] if len(rest) > 11 else None,
        frame=frame,
        track_id=track_id,
    )


def _parse_tracked(line: str) -> Box:
    """Parse the box of one line with a frame.

    Raises:
        ValueError: As parse_box, or it has none.
    """
    box = parse_box(line)
    if box.frame is None:
        raise ValueError(f'{len(line.split())} columns')
    return box


def format_object_labels(boxes: Iterable[Box], decimals: int = 2) -> str:
    """Format an object label file; frame and track id are left out."""
    return ''.join(f'{format_object_box(box, decimals)}\n' for box in boxes)


KITTI_DECIMALS = 2
"""Of KITTI's object labels."""
_OFF_LABEL = 5e-5
"""A number nearer to one of two decimals is that: four would print it so."""


def fitting_decimals(box: Box, most: int) -> int:
    """Return KITTI's decimals if size, place and heading of a box have no more; else the most.

    A box without 3D box is asked for its 2D box.
    """
    solid = (*box.size_hwl, *box.location, box.rotation_y)
    values = solid if box.size_hwl[0] > 0 else box.box_2d
    on_two = all(abs(value - round(value, KITTI_DECIMALS)) < _OFF_LABEL for value in values)
    return min(KITTI_DECIMALS, most) if on_two else most


def format_tracking_labels(boxes: Iterable[Box]) -> str:
    """Format a tracking label file, or a part of it."""
    return ''.join(f'{format_tracking_box(box)}\n' for box in boxes)


def format_object_box(box: Box, decimals: int = 2) -> str:
    """Format the line of a box in an object file, without its end; the inverse of parse_box."""
    care = decimals if box.class_name != DONT_CARE else 0
    columns = [
        box.class_name,
        f'{box.truncated:.{care}f}',
        f'{box.occluded:d}',
        f'{box.alpha:.{care}f}',
        *(f'{value:.{decimals}f}' for value in box.box_2d),
        *(f'{value:.{care}f}' for value in (*box.size_hwl, *box.location, box.rotation_y)),
    ]
    if box.score is not None:
        columns.append(f'{box.score:.6f}')
    return ' '.join(columns)


def format_tracking_box(box: Box) -> str:
    """Format the line of a box in a tracking file, without its end; the inverse of parse_box.

    Raises:
        ValueError: The box has no frame or no track id.
    """
    if box.frame is None or box.track_id is None:
        raise ValueError('a tracking label needs a frame and a track id')
    numbers = (box.alpha, *box.box_2d, *box.size_hwl, *box.location, box.rotation_y)
    columns = [
        f'{box.frame:d} {box.track_id:d} {box.class_name}',
        f'{box.truncated:.6f}'.rstrip('0').rstrip('.'),
        f'{box.occluded:d}',
        *(f'{value:.6f}' for value in numbers),
    ]
    if box.score is not None:
        columns.append(f'{box.score:.6f}')
    return ' '.join(columns)


def _parse_integer(word: str) -> int:
    """Parse an integer, which some writers give a decimal point (0.0)."""
    (value,) = parse_numbers([word], 1)
    if not value.is_integer():
        raise ValueError(f'{word!r} is no whole number')
    return int(value)


# A label file of the tracking layout, or the result file of a tracker, by frame.


class TrackFile:
    """The lines of a file with the labels of all frames of a sequence; see label_file.

    Raises:
        BadFileError: More than a thousand lines have no frame number, or too few or many columns.

    Attributes:
        path: The file.
        rows: By frame number the rows of its lines, from 0.
        errors: An error for each line without a frame number.
    """

    def __init__(self, text: str, path: Path) -> None:
        self.path = path
        self.rows: dict[int, list[int]] = {}
        self.errors: list[BadFileError] = []
        self._lines = text.splitlines(keepends=True)
        for row, line in enumerate(self._lines):
            word = line.split(maxsplit=1)[0] if line.strip() else ''
            whole = word.removeprefix(BOM).removesuffix('.0')
            if whole.isdecimal() and len(whole) <= names.FRAME_DIGITS:
                self.rows.setdefault(int(whole), []).append(row)
            elif word:
                problem, expected = f'{word!r} is no frame number', 'frame, track id, class, ...'
                self.errors.append(BadFileError(path, problem, expected, line=row + 1))
                check_count(self.errors, path, expected)
        framed = ((row + 1, self._lines[row]) for rows in self.rows.values() for row in rows)
        check_columns(framed, TRACK_COLUMNS, path, EXPECTED_TRACKS)

    def _rows(self, number: int) -> dict[int, Box | BadFileError]:
        return {
            row: parse_track(self._lines[row].removeprefix(BOM), self.path, row + 1)
            for row in self.rows.get(number, ())
        }

    def boxes(self, number: int) -> tuple[list[Box], list[BadFileError]]:
        """Return the boxes of a frame, and an error for each invalid line."""
        parsed = self._rows(number).values()
        boxes = [row for row in parsed if not isinstance(row, BadFileError)]
        return boxes, [row for row in parsed if isinstance(row, BadFileError)]

    def labels(self, number: int, name: str) -> FrameLabels:
        """Return the labels of a frame, none if it has no line.

        Args:
            number: The frame.
            name: The file's name in the recording.
        """
        rows = self._rows(number)
        source = TextFile(name, ''.join(self._lines[row] for row in rows))
        return frame_labels(rows, source, self.path)


# Label files by frame, and result files of a detector or tracker in the same format.

_DATA = 'data'
"""The sub-folder for result files of the devkits' evaluation and OpenPCDet."""
_NAMED = f'{"0" * FRAME_DIGITS}{TXT}'
_MOST_FOLDERS = 200
_MOST_READ = 20
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
        UsageError: The path contains no result file; the message names the remedy.
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
        digits: Digits of the names; SEQUENCE_DIGITS for a tracker's files.
    """
    return next((folder for folder in (path, path / _DATA) if _named_by(folder, digits)), None)


def _named_by(folder: Path, digits: int) -> bool:
    texts = [name for name in STORE.names(folder) if _is_text(name)]
    if any(len(number_text(name)) == digits for name in texts):
        return True
    return digits == FRAME_DIGITS and _are_labels(folder, texts[:_MOST_READ])


def _is_text(name: str) -> bool:
    return split_name(name)[1].lower() == TXT and not name.startswith('.')


def number_text(name: str) -> str:
    """Return the digits of a numbered file; empty for another name."""
    stem = split_name(name)[0]
    return stem if number_of(stem) is not None else ''


def _are_labels(folder: Path, texts: Sequence[str]) -> bool:
    """Return whether files of other names than KITTI's hold labels of a frame each."""
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
        folder = next((base for base in (path, path / _DATA) if _is_of(base, frames)), None)
        if folder is None:
            expected = f'expected a file like {frames.stem(0)}{TXT} for each frame'
            raise UsageError(f'{path}: holds {some_of(STORE.names(path)) or "nothing"}; {expected}')
        return folder
    folder = find_frame_files(path)
    if folder is None:
        raise UsageError(f'{path}: {_describe_folder(path)}')
    return folder


def _is_of(folder: Path, frames: FileNames) -> bool:
    return bool(len(STORE.list_numbered(folder, (TXT,), FRAME_DIGITS, frames).numbers))


def _describe_folder(path: Path) -> str:
    """Describe a folder without files named by frame, and what to give instead."""
    entries = STORE.names(path)
    if not entries:
        return f'the folder is empty; expected a file like {_NAMED} for each frame'
    below = [path / name for name in entries[:_MOST_FOLDERS] if name not in _OF_DATA_SETS]
    folders = [base for folder in below if (base := find_frame_files(folder)) is not None]
    if folders:
        return f'contains no file like {_NAMED}; did you mean {some_of([*map(str, folders)])}?'
    if not _OF_DATA_SETS.union(SPLITS).isdisjoint(entries):
        return (
            f'is a folder of a KITTI data set; expected result files like {_NAMED}'
            f' (eval detection takes GROUND_TRUTH first, then RESULTS)'
        )
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
