# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label files: label_2/NNNNNN.txt (object) and label_02/SSSS.txt (tracking), one object a line.

Columns, separated by blanks (source: readme.txt of the object and tracking devkits):

- tracking only: frame (file number), track id (-1 for DontCare)
- type: a word; custom ones are legal
- truncated: object 0..1, the part that leaves the image; tracking a level 0, 1, 2; -1 unknown
- occluded: 0 visible, 1 partly, 2 largely, 3 unknown, -1 DontCare
- alpha: observation angle, radians, -pi..pi; -10 for DontCare
- left, top, right, bottom: 2D box, pixels, 0-based
- height, width, length: metres; -1 for DontCare
- x, y, z: the bottom face's centre in the rectified camera 0 frame, metres; -1000 for DontCare
- rotation_y: heading about the camera's y axis, radians, -pi..pi; -10 for DontCare
- score: detections only

Object files have two decimals, tracking files six.

label_all of Waymo in KITTI's format has the camera of the 2D box where results have the score, and
maybe a name of the track behind it (source: save_label of mmdetection3d's converter, 1.1).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from ..model.boxes import DONT_CARE, Box, is_absurd
from ..model.errors import BadFileError
from ..model.samples import FrameLabels
from .names import WAYMO_LABELS
from .text_file import Lines, parse_lines, parse_numbers

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from ..model.samples import TextFile

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
    place = PurePath(path) if isinstance(path, str) else path
    of_all = place.parent.name == WAYMO_LABELS
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
        number: Of the line, from 1.
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
            found = 'a box of height, width, length ' + ' '.join(f'{v:g}' for v in box.size_hwl)
            error = BadFileError(path, found, 'positive sizes', line=row + 1)
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
