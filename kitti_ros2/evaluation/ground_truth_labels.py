# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The labels that results are compared with: label files, or the labels of a recording."""

from __future__ import annotations

from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from ..bags.locate import is_bag
from ..importer.labels import ImageOf, TrackIds, make_boxes
from ..kitti.layouts import open_recording
from ..kitti.names import LABEL_FOLDERS, SPLITS, TRACKING_LABELS, TXT
from ..kitti.result_files import find_frame_files
from ..kitti.store import STORE
from ..model.errors import KittiRos2Error, MissingPathError, UsageError, describe_error
from ..model.layouts import Layout
from ..model.losses import Loss
from ..model.streams import Stream
from ..options.read import ReadOptions
from .frame_boxes import FrameBoxes, read_boxes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..kitti.names import FileNames
    from ..kitti.recording import KittiRecording
    from ..model.boxes import Box
    from ..model.samples import FrameLabels
    from ..own_bags.recording import BagRecording
    from .frame_boxes import Progress

_STREAM = 'ground truth'
_CAMERA = 2


def read_ground_truth(
    path: Path, options: ReadOptions, progress: Progress = lambda: None
) -> FrameBoxes:
    """Read the labels of a path.

    Args:
        path: label_2, a split or root of the object layout, label_02 or a file of it, or a
            recording with labels: its folder, or a bag that to-bag wrote.
        options: Layout and sequence of a recording.
        progress: Called for each frame.

    Raises:
        KittiRos2Error: There are no labels; the message says what to give.
    """
    if not path.exists():
        raise MissingPathError(path)
    if holds_bag(path):
        with open_truth_bag(path) as recording:
            return _read_recording(path, recording, progress)
    files = path if path.is_file() else _label_folder(path, options)
    if files is not None:
        return read_boxes(files, _STREAM, progress, _names_around(files))
    return _read_recording(
        path, open_recording(*recording_of(path, options), scans=False), progress
    )


def holds_bag(path: Path) -> bool:
    """Whether a path is a bag; a text file named .txt is none, even if it is empty."""
    return path.suffix != TXT and is_bag(path)


@contextmanager
def open_truth_bag(path: Path) -> Iterator[BagRecording]:
    """Open the recording in a bag.

    Raises:
        UsageError: to-bag did not write the bag.
    """
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - readers of bags take 0.2 s
    from ..importer.survey import look  # noqa: PLC0415 - as above
    from ..pictures.sources import open_own_recording  # noqa: PLC0415 - as above

    with open_bag_source(path) as bag:
        recording = open_own_recording(bag, look([bag]))
        if recording is None:
            raise UsageError(
                f'{path}: was not written by to-bag, so that its labels have no frame numbers;'
                f' convert it with to-kitti, and give that folder'
            )
        with closing(recording):
            yield recording


def recording_of(path: Path, options: ReadOptions) -> tuple[Path, ReadOptions]:
    """Return the path of the recording that labels belong to, and the options to open it.

    Args:
        path: As given to read_ground_truth.
        options: The same.
    """
    whole = path.absolute()
    if whole.name == TRACKING_LABELS:
        return whole.parent, replace(options, layout=Layout.TRACKING)
    if whole.parent.name == TRACKING_LABELS and whole.is_file():
        sequence = options.sequence or whole.stem
        return whole.parents[1], replace(options, layout=Layout.TRACKING, sequence=sequence)
    folder = _label_folder(whole, options)
    if folder is not None and folder.name in LABEL_FOLDERS:
        return folder.parent, options
    return path, options


def _names_around(files: Path) -> FileNames | None:
    """Return the names of the frames of the set that labels belong to, if they are no numbers."""
    if files.name not in LABEL_FOLDERS or not STORE.find_frames({files: (TXT,)}, 1).stems:
        return None
    return open_recording(files.parent, ReadOptions(layout=Layout.OBJECT)).file_names


def _label_folder(path: Path, options: ReadOptions) -> Path | None:
    """Return the folder with the labels of the object layout; None for other recordings."""
    if options.layout is not None or options.sequence is not None:
        return None
    folders = [
        path,
        *(folder / name for folder in (path, path / SPLITS[0]) for name in LABEL_FOLDERS),
    ]
    return next(filter(None, map(find_frame_files, folders)), None)


def _read_recording(
    path: Path, recording: KittiRecording | BagRecording, progress: Progress
) -> FrameBoxes:
    """Read the labels of a recording; a frame of a drive or sequence may have none."""
    if Stream.LABELS not in recording.streams:
        raise UsageError(
            f'{path}: {recording.layout.value} {recording.name} has no labels (KITTI publishes'
            f' none of {SPLITS[1]}); give label_2 of {SPLITS[0]}, or a drive or sequence that has'
            f' labels'
        )
    numbers = set(recording.streams[Stream.LABELS].numbers.tolist())
    if not recording.layout.traits.frame_set:
        for stream in {Stream.SCAN, Stream.IMAGE_2} & recording.streams.keys():
            numbers |= {*recording.streams[stream].numbers.tolist()}
    labelled = {*recording.streams[Stream.LABELS].numbers.tolist()}
    tracks = TrackIds()
    boxes: dict[int, Sequence[Box]] = {}
    losses: list[Loss] = []
    unset = 0
    for number in sorted(numbers):
        progress()
        boxes[number] = ()
        if number not in labelled:
            continue
        try:
            labels: FrameLabels = recording.read(Stream.LABELS, number)  # type: ignore[assignment]
            boxes[number] = _boxes_of(labels, recording, number, tracks)
        except (KittiRos2Error, OSError, ValueError) as error:
            del boxes[number]
            reason = str(error) if isinstance(error, ValueError) else describe_error(error)
            losses.append(Loss(_STREAM, 1, reason, (number,)))
            continue
        losses += [Loss(_STREAM, 1, reason, (number,)) for reason in labels.missing.values()]
        unset += sum(each.occluded is None for each in labels.cuboids)
    notes = (f'{path}: {unset} boxes without occlusion count as visible',) if unset else ()
    return FrameBoxes(path, boxes, losses=tuple(losses), notes=notes, frames=recording.file_names)


def _boxes_of(
    labels: FrameLabels,
    recording: KittiRecording | BagRecording,
    number: int,
    tracks: TrackIds,
) -> list[Box]:
    """Return the labels of a frame; those of tracklets are projected into camera 2.

    Raises:
        ValueError: A required part of the calibration is missing.
    """
    if not labels.cuboids:
        return [box for box in labels.boxes if box is not None]
    calibration = recording.calibration(number)
    camera = calibration.cameras.get(_CAMERA)
    if camera is None or camera.size is None:
        raise ValueError(f'{recording.name}: camera {_CAMERA} has no calibration with image size')
    image = ImageOf(_CAMERA, camera.size)
    # The benchmark limits the truncated part, of which tracklets have a level.
    cuboids = [replace(each, truncation=None) for each in labels.cuboids]
    return make_boxes(cuboids, calibration, image, tracks)[0]
