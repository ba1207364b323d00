# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Result files of a detector or tracker, in the format of label files, compared with labels."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from ..drawing.objects import objects_of
from ..kitti.label_file import parse_labels
from ..kitti.names import FRAME_DIGITS, SEQUENCE_DIGITS, TXT, file_name
from ..kitti.store import STORE
from ..model.errors import BadFileError, UsageError
from ..model.matching import match
from ..model.samples import FrameLabels

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..model.boxes import Box
    from .frame import FrameData

_DATA = 'data'
"""The sub-folder for result files of the devkits' evaluation and OpenPCDet."""


class Predictions:
    """Result files of one recording.

    Attributes:
        path: A tracker's file (lines of all frames, like label_02), or a folder with a file for
            each frame (like label_2), directly or in its data/.

    Raises:
        UsageError: The path contains no result file.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise UsageError(f'{path}: no such file or folder; expected label files of predictions')
        self.path = path
        self._folder = path / _DATA if (path / _DATA).is_dir() else path
        names = STORE.names(self._folder)
        if path.is_dir() and not any(_is_number(name, FRAME_DIGITS) for name in names):
            tracks = [name for name in names if _is_number(name, SEQUENCE_DIGITS)]
            hint = f'; give one of its files, such as {tracks[0]}' if tracks else ''
            raise UsageError(f'{self._folder}: holds no file named like 000000.txt{hint}')

    def add_to(self, frame: FrameData) -> FrameData:
        """Return the frame with its predictions, compared with its labels if it has any.

        Bad lines are in its missing.
        """
        missing: dict[str, str] = {}
        try:
            boxes = self._boxes(frame.number, missing)
        except (BadFileError, OSError) as error:
            boxes = []
            missing['predictions'] = str(error)
        found = objects_of(FrameLabels(boxes=boxes), frame.calibration)
        frame = replace(frame, predictions=found, missing={**frame.missing, **missing})
        return compared(frame) if frame.labelled and 'predictions' not in missing else frame

    def _boxes(self, number: int, missing: dict[str, str]) -> list[Box]:
        if not self.path.is_dir():
            return self._tracks.get(number, [])
        path = self._folder / file_name(number, FRAME_DIGITS, TXT)
        if not path.is_file():
            missing['predictions'] = f'{self._folder}: no label file for frames {{}}'
            return []
        lines = parse_labels(STORE.read_text(path), path)
        missing |= {f'predictions {row}': str(error) for row, error in lines.errors.items()}
        return [box for box in lines.values if box is not None]

    @cached_property
    def _tracks(self) -> Mapping[int, list[Box]]:
        """The boxes of a tracker's file by frame.

        Raises:
            BadFileError: A line is invalid.
        """
        lines = parse_labels(STORE.read_text(self.path), self.path)
        for error in lines.errors.values():
            raise error
        frames: dict[int, list[Box]] = {}
        for row, box in enumerate(lines.values):
            if box is None:
                continue
            if box.frame is None:
                expected = '17 or 18 columns, of which the first is the frame'
                raise BadFileError(self.path, 'no frame number', expected, line=row + 1)
            frames.setdefault(box.frame, []).append(box)
        return frames


def compared(frame: FrameData) -> FrameData:
    """Return the frame with the match of each label and prediction."""
    matches = match(frame.objects, frame.predictions)
    objects, predictions = (
        [replace(each, match=found) for each, found in zip(some, of_some, strict=True)]
        for some, of_some in zip((frame.objects, frame.predictions), matches, strict=True)
    )
    return replace(frame, objects=objects, predictions=predictions)


def _is_number(name: str, digits: int) -> bool:
    stem = name.removesuffix(TXT)
    return name.endswith(TXT) and len(stem) == digits and stem.isdecimal()
