# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is kept of a bag whose writing was interrupted: its path, and the words about it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import chain, count
from typing import TYPE_CHECKING

from ..files.staging import Staging
from ..model.errors import OutputError, add_note
from ..model.text import format_count

if TYPE_CHECKING:
    from pathlib import Path

    from ..files.upload_staging import UploadStaging

_PARTIAL = 'partial'


@dataclass(frozen=True)
class KeptBag:
    """What is kept of a bag.

    Attributes:
        path: Where it is.
        messages: Number of messages that were written.
        whole: Whether it is a valid bag of these messages, not one that breaks off.
    """

    path: Path
    messages: int
    whole: bool

    @property
    def text(self) -> str:
        """Readable text, for the end of an error."""
        text = f'{format_count(self.messages, "message")} written so far are kept in {self.path}'
        return text if self.whole else f'{text}, which kitti-ros2 recover repairs'

    def name_in(self, error: BaseException) -> None:
        """Let an error name what is kept."""
        if isinstance(error, OutputError):
            error.leave(self.text)
        else:
            add_note(error, self.text)


def is_interruption(error: BaseException) -> bool:
    """Whether an exception is no fault of the data: a signal, the disk, or too little memory."""
    return isinstance(error, (KeyboardInterrupt, SystemExit, OutputError, OSError, MemoryError))


def move_aside(staging: Staging | UploadStaging, *, single_file: bool) -> Path | None:
    """Move what was written beside the output: to drive.partial.mcap, or drive.partial.

    Returns:
        Its path; None if the disk refuses.
    """
    if not isinstance(staging, Staging):  # in a store
        return None
    path = _free_path(staging.path, single_file=single_file)
    try:
        staging.keep(path)
    except OSError:
        return None
    return path


def _free_path(path: Path, *, single_file: bool) -> Path:
    stem, suffix = (path.stem, path.suffix) if single_file else (path.name, '')
    marks = chain([_PARTIAL], (f'{_PARTIAL}-{number}' for number in count(2)))
    paths = (path.with_name(f'{stem}.{mark}{suffix}') for mark in marks)
    return next(each for each in paths if not os.path.lexists(each))
