# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions of a detector or tracker as a stream of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import UsageError
from ..model.losses import Loss, describe_frames
from ..model.recording import StreamIndex
from ..model.streams import FRAME_STREAMS, Stream
from .result_files import ResultFiles

if TYPE_CHECKING:
    from pathlib import Path

    from .recording import KittiRecording

_STREAMS = (Stream.LABELS, *(each for each in FRAME_STREAMS if each is not Stream.LABELS))


def add_predictions(recording: KittiRecording, path: Path | None) -> None:
    """Add result files to a recording, with the stamps of its labels, or else of its scans.

    Frames without a result file are losses, and so are result files of other frames.

    Args:
        recording: Gets the stream of predictions.
        path: A folder with a file for each frame, or a tracker's file; None adds nothing.

    Raises:
        UsageError: The path contains no result file, or none of a frame of the recording.
        BadFileError: A tracker's file is no text.
        OSError: It cannot be read.
    """
    if path is None:
        return
    results = ResultFiles(path, frames=recording.frames)
    stamps = _frame_stamps(recording)
    own, known = {*results.numbers}, sorted(stamps)
    if not own & {*known}:
        frames = describe_frames(known) if known else 'none'
        of_results = describe_frames(results.numbers) if own else 'none'
        raise UsageError(
            f'{results.root}: contains results of {of_results}; {recording.name} has {frames}'
        )
    absent = results.absent(known)
    lost = {*absent.numbers} if absent is not None else set()
    numbers = np.array([number for number in known if number not in lost], np.int64)
    stamps_ns = np.array([stamps[number] for number in numbers.tolist()], np.int64)
    recording.results = results
    recording.streams[Stream.PREDICTIONS] = StreamIndex(numbers, stamps_ns)
    recording.losses += [*results.losses, *([] if absent is None else [absent])]
    others = sorted(own - {*known})
    if others:
        reason = f'{results.root}: results of frames {{}}, which {recording.name} does not have'
        recording.losses.append(Loss(Stream.PREDICTIONS.value, len(others), reason, tuple(others)))


def _frame_stamps(recording: KittiRecording) -> dict[int, int]:
    """Return the stamp of each frame; a raw extract counts its frames by the scans."""
    present = [recording.streams[each] for each in _STREAMS if each in recording.streams]
    found: dict[int, int] = {}
    for index in reversed(present if recording.common_numbers else present[:1]):
        found |= zip(index.numbers.tolist(), index.stamps_ns.tolist(), strict=True)
    return found
