# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label files and result files of a detector: a file for each frame, NNNNNN.txt, in one folder.

A file of a tracker, with the frame in its first column, is read as well. The format is documented
in kitti/label_file.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..kitti.label_file import parse_labels
from ..kitti.names import FRAME_DIGITS, SEQUENCE_DIGITS, TXT
from ..kitti.store import STORE
from ..model.errors import BadFileError, MissingPathError, UsageError, describe_error
from ..model.losses import Loss
from ..model.text import some_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Box

    Progress = Callable[[], None]

DATA = 'data'
"""The sub-folder for result files of the devkits' evaluation and OpenPCDet."""

_NAMED = f'{"0" * FRAME_DIGITS}{TXT}'
_MOST_FOLDERS = 200


@dataclass(frozen=True)
class FrameBoxes:
    """The boxes of labels or results by frame.

    Attributes:
        source: The file or folder.
        boxes: By frame number, ascending; a frame may have none.
        complete: Whether frames that are not in boxes have no objects, as in a tracker's file;
            otherwise nothing is known of them.
        losses: Lines and files that could not be read.
        notes: Other remarks, one line each.
    """

    source: Path
    boxes: Mapping[int, Sequence[Box]]
    complete: bool = False
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()


def read_results(path: Path, progress: Progress = lambda: None) -> FrameBoxes:
    """Read the results of a detector: a folder of files by frame, or a tracker's file.

    Raises:
        UsageError: The path contains no result files; the message says what to give.
    """
    if path.is_file():
        return read_frame_column(path, 'results')
    folder = find_frame_files(path)
    if folder is not None:
        return read_frame_files(folder, 'results', progress)
    if not path.exists():
        raise MissingPathError(path)
    raise UsageError(f'{path}: {_describe_folder(path)}')


def find_frame_files(path: Path) -> Path | None:
    """Return the folder with files named by frame: a path, or its data/; None without such files.

    The folder itself comes first, as in a devkit's results, whose data/ is beside figures.
    """
    return next((each for each in (path, path / DATA) if _has_frame_files(each)), None)


def read_frame_files(folder: Path, stream: str, progress: Progress = lambda: None) -> FrameBoxes:
    """Read the boxes of a folder of files named by frame; invalid lines are losses."""
    listing = STORE.list_numbered(folder, (TXT,), FRAME_DIGITS)
    boxes: dict[int, list[Box]] = {}
    losses: list[Loss] = []
    for number in listing.numbers.tolist():
        path = listing.path(number)
        progress()
        try:
            lines = parse_labels(STORE.read_text(path), path)
        except (BadFileError, OSError) as error:
            losses.append(Loss(stream, 1, describe_error(error), (number,)))
            continue
        boxes[number] = list(lines.sound().values())
        losses += [Loss(stream, 1, str(error), (number,)) for error in lines.errors.values()]
    misnamed = [name for name in listing.strays if name.removesuffix(TXT).isdecimal()]
    if misnamed:
        message = (
            f'{folder}: {some_of(misnamed)}; expected names of {FRAME_DIGITS} digits, {_NAMED}'
        )
        losses.append(Loss(stream, len(misnamed), message))
    return FrameBoxes(folder, boxes, losses=tuple(losses))


def read_frame_column(path: Path, stream: str) -> FrameBoxes:
    """Read the boxes of a file whose first column is the frame; invalid lines are losses.

    Raises:
        BadFileError: It is no text file, or no line has a frame.
    """
    lines = parse_labels(STORE.read_text(path), path)
    boxes: dict[int, list[Box]] = {}
    losses = [Loss(stream, 1, str(error)) for error in lines.errors.values()]
    expected = (
        f'17 or 18 columns, of which the first is the frame, or a folder of files like {_NAMED}'
    )
    for row, box in lines.sound().items():
        if box.frame is None:
            raise BadFileError(path, 'no frame number', expected, line=row + 1)
        boxes.setdefault(box.frame, []).append(box)
    if losses and not boxes:
        raise BadFileError(path, 'no line is a label', expected)
    return FrameBoxes(path, dict(sorted(boxes.items())), complete=True, losses=tuple(losses))


def _has_frame_files(folder: Path) -> bool:
    return any(_is_number(name, FRAME_DIGITS) for name in STORE.names(folder))


def _is_number(name: str, digits: int) -> bool:
    stem = name.removesuffix(TXT)
    return name.endswith(TXT) and len(stem) == digits and stem.isascii() and stem.isdecimal()


def _describe_folder(path: Path) -> str:
    """Describe a folder without files named by frame, and what to give instead."""
    entries = STORE.names(path)
    if not entries:
        return f'the folder is empty; expected a file like {_NAMED} for each frame'
    below = [path / name for name in entries[:_MOST_FOLDERS] if (path / name).is_dir()]
    found = [each for folder in below if (each := find_frame_files(folder)) is not None]
    if found:
        return f'contains no file like {_NAMED}; did you mean {some_of([*map(str, found)])}?'
    tracks = [name for name in entries if _is_number(name, SEQUENCE_DIGITS)]
    hint = f'; give the file of one sequence, such as {path / tracks[0]}' if tracks else ''
    return f'contains no file like {_NAMED}, but {some_of(entries)}{hint}'
