# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The boxes of label files or result files, by frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..kitti.names import SIX_DIGITS, FileNames
from ..kitti.result_files import ResultFiles
from ..model.errors import BadFileError, describe_error
from ..model.losses import Loss

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Box

    Progress = Callable[[], None]


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
        frames: How the frames are named.
    """

    source: Path
    boxes: Mapping[int, Sequence[Box]]
    complete: bool = False
    losses: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    frames: FileNames = SIX_DIGITS


def read_boxes(
    path: Path,
    stream: str,
    progress: Progress = lambda: None,
    frames: FileNames | None = None,
) -> FrameBoxes:
    """Read all boxes of a folder of files named by frame, or of a tracker's file.

    Args:
        path: See ResultFiles.
        stream: For losses: invalid lines and files.
        progress: Called for each frame.
        frames: How the frames of the labels are named.

    Raises:
        UsageError: The path contains no such files; the message says what to give.
        BadFileError: A tracker's file is no text, or has no frame numbers.
        OSError: A tracker's file cannot be read.
    """
    files = ResultFiles(path, stream, frames)
    boxes: dict[int, list[Box]] = {}
    losses = [*files.losses]
    for number in files.numbers:
        progress()
        try:
            boxes[number], errors = files.boxes(number)
        except (BadFileError, OSError) as error:
            losses.append(Loss(stream, 1, describe_error(error), (number,)))
            continue
        losses += [Loss(stream, 1, str(error), (number,)) for error in errors]
    return FrameBoxes(files.root, boxes, files.complete, tuple(losses), frames=files.frames)
