# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Result files of a detector or tracker, in the format of label files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.errors import MissingDataError, MissingPathError, UsageError
from ..model.losses import Loss
from ..model.samples import TextFile
from ..model.streams import Stream
from .label_file import frame_labels, parse_labels
from .names import FRAME_DIGITS, SEQUENCE_DIGITS, TXT
from .store import STORE
from .track_file import TrackFile

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from ..model.samples import FrameLabels

_DATA = 'data'
"""The sub-folder for result files of the devkits' evaluation and OpenPCDet."""


class ResultFiles:
    """The predictions of one recording.

    Attributes:
        root: The folder with a file for each frame (like label_2): the path itself or its data/;
            or a tracker's file (lines of all frames, like label_02).
        numbers: The frames with predictions, ascending; of a folder those with a file.
        losses: Lines of a tracker's file without a frame number.

    Raises:
        UsageError: The path contains no result file.
        BadFileError: A tracker's file is no text.
        OSError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise MissingPathError(path)
        self.root = path / _DATA if (path / _DATA).is_dir() else path
        self.losses: tuple[Loss, ...] = ()
        self._absent = f'{self.root}: no result file for frames {{}}'
        self._tracks = None if path.is_dir() else TrackFile(STORE.read_text(path), path)
        if self._tracks is None:
            self.numbers = self._numbers_of_files()
        else:
            self.numbers = tuple(sorted(self._tracks.rows))
            self.losses = tuple(
                Loss(Stream.PREDICTIONS.value, 1, str(error)) for error in self._tracks.errors
            )
        self._known = frozenset(self.numbers)

    def _numbers_of_files(self) -> tuple[int, ...]:
        listing = STORE.list_numbered(self.root, (TXT,), FRAME_DIGITS)
        if not len(listing.numbers):
            tracks = [name for name in listing.strays if _is_of_sequence(name)]
            hint = f'; give one of its files, such as {tracks[0]}' if tracks else ''
            raise UsageError(f'{self.root}: contains no file named like 000000.txt{hint}')
        return tuple(listing.numbers.tolist())

    def path(self, number: int) -> Path:
        """Return the file of a frame."""
        return self.root / f'{number:0{FRAME_DIGITS}d}{TXT}' if self._tracks is None else self.root

    def read(self, number: int) -> FrameLabels:
        """Read the predictions of a frame; invalid lines are in its missing.

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
        return frame_labels(parse_labels(text, path), TextFile(path.name, text), path)

    def absent(self, numbers: Collection[int]) -> Loss | None:
        """Return the loss of the frames without a result file; a tracker's file has all frames."""
        if self._tracks is not None or self._known.issuperset(numbers):
            return None
        lost = tuple(sorted({*numbers} - self._known))
        return Loss(Stream.PREDICTIONS.value, len(lost), self._absent, lost)


def _is_of_sequence(name: str) -> bool:
    stem = name.removesuffix(TXT)
    return name.endswith(TXT) and len(stem) == SEQUENCE_DIGITS and stem.isdecimal()
