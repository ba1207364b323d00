# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A label file of the tracking layout, or the result file of a tracker, by frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.errors import BadFileError
from ..model.samples import TextFile
from . import names
from .label_file import EXPECTED_TRACKS, TRACK_COLUMNS, frame_labels, parse_track
from .text_file import BOM, check_columns, check_count

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.samples import FrameLabels


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
                found, expected = f'{word!r} is no frame number', 'frame, track id, class, ...'
                self.errors.append(BadFileError(path, found, expected, line=row + 1))
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
        found = self._rows(number).values()
        boxes = [each for each in found if not isinstance(each, BadFileError)]
        return boxes, [each for each in found if isinstance(each, BadFileError)]

    def labels(self, number: int, name: str) -> FrameLabels:
        """Return the labels of a frame, none if it has no line.

        Args:
            number: The frame.
            name: The file's name in the recording.
        """
        rows = self._rows(number)
        source = TextFile(name, ''.join(self._lines[row] for row in rows))
        return frame_labels(rows, source, self.path)
