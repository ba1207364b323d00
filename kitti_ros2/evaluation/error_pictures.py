# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the frames with the most errors of a detector."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..drawing.primitives import captioned
from ..model.boxes import NEIGHBOURS
from ..model.classes import KITTI_OVERLAPS, LeastOverlaps
from ..model.errors import NotKittiError, UsageError
from ..model.samples import FrameLabels
from ..model.streams import Stream
from ..options.outputs import PictureOptions
from ..pictures.painters import Predictions
from ..pictures.panel import MODES
from ..pictures.recording_frames import open_frames
from ..pictures.series import PictureTally, concerned_losses, draw_frames, write_picture
from .ground_truth import recording_of

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from ..model.boxes import Box
    from ..model.errors import Loss
    from ..options.read import ReadOptions
    from ..pictures.recording_frames import RecordingFrames
    from .detection import WorstFrame

_MODE = 'panel'
_LEAST_DIGITS = 2


def open_pictures(ground_truth: Path, options: ReadOptions) -> RecordingFrames:
    """Open the images and scans of the recording to which labels belong.

    Args:
        ground_truth: See read_ground_truth.
        options: Layout and sequence of a recording.

    Raises:
        KittiRos2Error: The labels belong to no recording with images or scans.
    """
    path, read = recording_of(ground_truth, options)
    expected = 'give as GROUND_TRUTH the split or recording that has image_2 or velodyne'
    try:
        source = open_frames(path, read)
    except NotKittiError:
        fault = f'{ground_truth}: belongs to no recording with images, to draw errors on'
        raise UsageError(f'{fault}; {expected}') from None
    if not source.cameras and Stream.SCAN.value not in source.streams:
        source.close()
        raise UsageError(f'{path}: has neither images nor scans, to draw errors on; {expected}')
    return source


def draw_worst_frames(
    source: RecordingFrames,
    worst: Sequence[WorstFrame],
    results: Mapping[int, Sequence[Box]],
    folder: Path,
    overlaps: LeastOverlaps = KITTI_OVERLAPS,
    *,
    classes: Collection[str] = (),
    progress: Callable[[int], None] = lambda _: None,
) -> tuple[Loss, ...]:
    """Draw frames with their errors: RANK_NUMBER.png, such as 01_000123.png.

    Args:
        source: The recording of the ground truth.
        worst: The result of worst_frames.
        results: The predictions by number.
        folder: An existing folder.
        overlaps: See worst_frames.
        classes: See worst_frames; only these and similar classes are drawn.
        progress: Called with the number of frames done.

    Returns:
        Missing or damaged data of the frames.

    Raises:
        MissingDataError: No frame could be drawn.
        UsageError: The source does not have a frame.
        OSError: A picture cannot be written.
    """
    predictions = Predictions(lambda number: FrameLabels(results.get(number, ())), overlaps)
    ranks = {frame.number: (rank, frame) for rank, frame in enumerate(worst, 1)}
    digits = max(len(str(len(worst))), _LEAST_DIGITS)
    similar = (name for class_name in classes for name in NEIGHBOURS.get(class_name, ()))
    options = PictureOptions(classes=(*classes, *similar))
    series = draw_frames(source, [*ranks], MODES[_MODE], options, predictions.add_to)
    tally = PictureTally()
    for number, picture in tally.pictures(series, progress):
        rank, frame = ranks[number]
        text = f'{rank}. frame {number}: {frame.reason}'
        write_picture(folder / f'{rank:0{digits}d}_{number:06d}.png', captioned(picture, text))
    if worst:
        tally.check()
    return (*concerned_losses(source, [*ranks], MODES[_MODE], options), *tally.losses())
