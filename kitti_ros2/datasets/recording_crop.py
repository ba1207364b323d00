# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts the scans of one recording, and places its other files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..files.workers import ordered_map, worker_count
from ..kitti.store import STORE
from ..model.errors import KittiRos2Error, describe_error
from ..model.losses import Loss, format_numbers
from ..model.streams import Stream
from ..options.crop import EmptyLabels
from .crop_paths import CropPaths
from .empty_labels import without_tracks
from .scan_crop import ScanCropper

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path, PurePosixPath

    from ..files.hard_links import FilePlacer
    from ..kitti.recording import KittiRecording
    from ..options.crop import CropOptions
    from .scan_crop import CutScan


@dataclass
class CroppedRecording:
    """A recording of the new data set.

    Attributes:
        name: Of the drive, split or sequence.
        folder: Folder of the cut scans in the data set.
        scans: Number of scans.
        points_before, points_after: Number of their points.
        labels_dropped: Number of labels that are left out.
        linked, copied: Number of unchanged files, by hard link and as copies.
        size_bytes: Of the files that are new.
    """

    name: str
    folder: str
    scans: int = 0
    points_before: int = 0
    points_after: int = 0
    labels_dropped: int = 0
    linked: int = 0
    copied: int = 0
    size_bytes: int = 0


class RecordingCrop:
    """Cuts the scans of one recording, and places its other files.

    Attributes:
        result: The recording of the new data set, so far.
        tops: The files and folders that contain all of its files.
    """

    def __init__(self, recording: KittiRecording, options: CropOptions, placer: FilePlacer) -> None:
        self._recording = recording
        self._options = options
        self._placer = placer
        self._paths = CropPaths(recording, options)
        self.tops = self._paths.tops
        self._failures: dict[tuple[Stream, str], list[int]] = {}
        self._emptied: list[int] = []
        self.result = CroppedRecording(recording.name, str(self._paths.scan_folder))

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._paths.numbers)

    @property
    def losses(self) -> list[Loss]:
        """What could not be used so far, and what is missing in the recording."""
        failed = [
            _loss(stream, reason, numbers) for (stream, reason), numbers in self._failures.items()
        ]
        needed = {Stream.SCAN.value}
        drop = self._options.empty_labels is EmptyLabels.DROP
        if drop and Stream.LABELS not in self._recording.streams:  # a file that is unreadable
            needed.add(Stream.LABELS.value)
        return failed + [loss for loss in self._recording.losses if loss.stream in needed]

    @property
    def notes(self) -> list[str]:
        """Remarks so far."""
        if not self._emptied:
            return self._paths.notes
        numbers = format_numbers(self._emptied)
        return [
            *self._paths.notes,
            f'{self.result.folder}: no point is left in frames {numbers}; their files are empty',
        ]

    def run(self, root: Path, taken: set[PurePosixPath]) -> Iterator[int]:
        """Write the recording, and yield the number of each scan that is done.

        Args:
            root: Folder of the new data set.
            taken: Places of files that recordings share, which are added.

        Raises:
            OSError: The output cannot be written.
        """
        for source, place in self._paths.others(self._fail):
            if place not in taken:
                self._place(source, root / place)
        taken |= self._paths.single_files
        cropper = ScanCropper(self._recording, self._options, self._paths, self._placer, root)
        rows: dict[int, Sequence[int]] = {}
        for cut in ordered_map(cropper.crop, self._paths.numbers, worker_count()):
            self._add(cut)
            if cut.empty_rows:
                rows[cut.number] = cut.empty_rows
            yield cut.number
        self._put_tracks(root, rows)

    def _add(self, cut: CutScan) -> None:
        """Add the result of a frame."""
        result = self.result
        result.scans += cut.done
        result.points_before += cut.before
        result.points_after += cut.after
        result.labels_dropped += len(cut.empty_rows)
        result.linked += sum(cut.placed)
        result.copied += len(cut.placed) - sum(cut.placed)
        result.size_bytes += cut.size_bytes
        if cut.before and not cut.after:
            self._emptied.append(cut.number)
        for failure in cut.failures:
            self._failures.setdefault(failure, []).append(cut.number)

    def _put_tracks(self, root: Path, rows: dict[int, Sequence[int]]) -> None:
        """Write the label file of the whole recording without the empty labels."""
        paths = self._paths.tracks()
        if paths is None:
            return
        source, place = paths
        if not rows:
            self._place(source, root / place)
            return
        try:
            data = without_tracks(STORE.read_text(source), rows).encode()
        except (KittiRos2Error, OSError) as error:
            self._fail(error)
            return
        STORE.write(root / place, data, new=True)
        self.result.size_bytes += len(data)

    def _place(self, source: Path, target: Path) -> None:
        try:
            linked = self._placer.place(source, target)
        except KittiRos2Error as error:
            self._fail(error)
            return
        self.result.linked += linked
        self.result.copied += not linked

    def _fail(self, error: KittiRos2Error | OSError) -> None:
        self._failures[Stream.RECORDING, f'{describe_error(error)}; it is left out'] = []


def _loss(stream: Stream, reason: str, numbers: list[int]) -> Loss:
    """Return the loss of frames for one reason; of one frame the reason has the file."""
    text = reason.replace('{', '(').replace('}', ')')
    frames = ' (frames {})' if len(numbers) > 1 else ''
    return Loss(stream.value, max(1, len(numbers)), text + frames, tuple(numbers))
