# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the files of one frame: each is read once, and checked alone and with the others."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..files.image_files import parse_image
from ..kitti.calib_file import parse_calibration
from ..kitti.recording import no_calibration
from ..kitti.scan_file import POINT_BYTES
from ..kitti.store import STORE
from ..model.boxes import DONT_CARE
from ..model.errors import BadFileError
from ..model.samples import Calibration, FrameLabels, OxtsPacket, Scan
from ..model.scan_columns import KITTI_COLUMNS
from ..model.streams import Stream
from .calib_rules import CALIBRATION_RULES, CalibrationFile
from .file_rules import FILE_RULES, DataFile
from .frame_rules import (
    FRAME_RULES,
    LABEL_FRAME_RULES,
    SCAN_FRAME_RULES,
    FrameFiles,
    LabelledScan,
    near_boxes,
)
from .image_rules import IMAGE_RULES, ImageFile
from .label_rules import LABEL_RULES, LabelFile, LabelLine
from .rule import find_breaches
from .scan_rules import SCAN_RULES, ScanFile
from .tracklet_rules import TRACKLET_RULES, TrackletFrame

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..model.boxes import Cuboid
    from ..options.validating import ValidateOptions
    from .frame_rules import NearBox
    from .recording_rules import ImageShape
    from .rule import Breach

T = TypeVar('T')
_MOST_KNOWN = 64
"""Calibrations that are kept for frames with equal files."""


@dataclass
class FrameResult:
    """What was found in the files of a frame.

    Attributes:
        number: Of the frame.
        found: Breaches, each with the id of its rule.
        files, size_bytes: Of the frame.
        points: Number of points of the scan.
        images: Shapes of the images, by stream.
        packet: Its packet.
        occlusions: Those of its labels but DontCare.
    """

    number: int
    found: list[tuple[str, Breach]] = field(default_factory=list)
    files: int = 0
    size_bytes: int = 0
    points: int | None = None
    images: dict[Stream, ImageShape] = field(default_factory=dict)
    packet: OxtsPacket | None = None
    occlusions: Sequence[int] = ()

    def look(self, stream: Stream, path: Path, point_bytes: int = POINT_BYTES) -> DataFile | None:
        """Count a file and check its size; None if it is not worth reading."""
        file = DataFile.look(stream, path, point_bytes)
        self.files += 1
        if file.is_worth_reading:
            self.size_bytes += file.size
            return file
        self.found += find_breaches(FILE_RULES, file)
        return None

    def try_read(self, stream: Stream, path: Path, read: Callable[[], T]) -> T | None:
        """Return what a reader returns; None if it fails, which is a breach."""
        try:
            return read()
        except (BadFileError, OSError) as error:
            self.found += find_breaches(FILE_RULES, DataFile(stream, path, 0, error))
        return None


class FrameChecks:
    """Checks frames of a recording; called by several threads.

    Args:
        recording: The recording.
        options: What is read.
        calibration_path: The file of a calibration for all frames, or the folder of several.
        tracking: The labels of all frames, where they are in one file.
    """

    def __init__(
        self,
        recording: KittiRecording,
        options: ValidateOptions,
        calibration_path: Path,
        tracking: LabelFile | None,
    ) -> None:
        self._recording = recording
        self._options = options
        self._calibration_path = calibration_path
        self._tracking = tracking
        self._numbers = {
            stream: frozenset(listing.numbers.tolist())
            for stream, listing in recording.listings.items()
        }
        self._cameras = {
            stream: stream.camera for stream in self._numbers if stream.camera is not None
        }
        self._known: dict[str, Calibration] = {}
        self._point_bytes = (recording.options.columns or KITTI_COLUMNS).point_bytes

    @property
    def numbers(self) -> list[int]:
        """The numbers of all frames, ascending."""
        in_lines = [] if self._tracking is None else self._tracking.by_frame
        labelled = {number for number in in_lines if number is not None}
        return sorted(labelled.union(*self._numbers.values(), self._tracklet_numbers))

    @cached_property
    def _tracklet_numbers(self) -> frozenset[int]:
        labels = self._recording.streams.get(Stream.LABELS)
        if labels is None or not self._recording.layout.traits.tracklets or self._options.quick:
            return frozenset()
        return frozenset(labels.numbers.tolist())

    def __call__(self, numbers: Sequence[int]) -> list[FrameResult]:
        """Check some frames, one after the other, and their labels together."""
        with np.errstate(all='ignore'):  # files may hold any numbers
            checked = [self._check_others(number) for number in numbers]
            frames = {frame.number: frame for _, frame in checked if frame is not None}
            near = near_boxes([*frames.values()])
            for result, frame in checked:
                others, result.found = result.found, []
                self._check_scan(result, frame, near.get(result.number, []))
                result.found += others
            results = [result for result, _ in checked]
            results[-1].found += find_breaches(LABEL_FRAME_RULES, [*frames.values()])
        return results

    def _check_others(self, number: int) -> tuple[FrameResult, FrameFiles | None]:
        """Check the files of a frame but for its scan."""
        result = FrameResult(number)
        for stream in self._cameras:
            self._check_image(stream, number, result)
        self._check_packet(number, result)
        calibration, calibration_path = self._check_calibration(number, result)
        lines, cuboids, label_path = self._check_labels(number, result)
        result.occlusions = [
            line.box.occluded for line in lines if line.box.class_name != DONT_CARE
        ]
        if calibration is None or not self._recording.common_numbers:
            return result, None
        sizes = {self._cameras[stream]: shape[:2] for stream, shape in result.images.items()}
        frame = FrameFiles(number, calibration, sizes, calibration_path, label_path, lines, cuboids)
        result.found += find_breaches(FRAME_RULES, frame)
        return result, frame

    def _path(self, stream: Stream, number: int, result: FrameResult) -> Path | None:
        """Return the file of a stream if it is there and is to be read."""
        if number not in self._numbers.get(stream, ()):
            return None
        path = self._recording.path(stream, number)
        file = result.look(stream, path, self._point_bytes)
        return None if file is None or self._options.quick else path

    def _check_scan(
        self, result: FrameResult, frame: FrameFiles | None, boxes: Sequence[NearBox]
    ) -> None:
        number = result.number
        if self._recording.scan_error is not None:
            return
        path = self._path(Stream.SCAN, number, result)
        if path is None:
            return
        scan = result.try_read(Stream.SCAN, path, lambda: self._recording.read(Stream.SCAN, number))
        if not isinstance(scan, Scan):
            return
        result.points = len(scan.points)
        file = ScanFile(path, scan.points, next(iter(scan.missing.values()), ''))
        result.found += find_breaches(SCAN_RULES, file)
        if frame is not None:
            labelled = LabelledScan(frame, scan.points, boxes)
            result.found += find_breaches(SCAN_FRAME_RULES, labelled)

    def _check_image(self, stream: Stream, number: int, result: FrameResult) -> None:
        path = self._path(stream, number, result)
        if path is None:
            return
        image = result.try_read(stream, path, lambda: parse_image(STORE.read(path), path))
        if image is None:
            return
        result.images[stream] = image.width, image.height, image.channels
        if self._options.decode:
            result.found += find_breaches(IMAGE_RULES, ImageFile(path, image))

    def _check_packet(self, number: int, result: FrameResult) -> None:
        path = self._path(Stream.OXTS, number, result)
        if path is not None:
            packet = result.try_read(
                Stream.OXTS, path, lambda: self._recording.read(Stream.OXTS, number)
            )
            result.packet = packet if isinstance(packet, OxtsPacket) else None

    def _check_calibration(
        self, number: int, result: FrameResult
    ) -> tuple[Calibration | None, Path]:
        if self._options.quick:
            self._path(Stream.CALIBRATION, number, result)
            return None, self._calibration_path
        if not self._recording.layout.traits.calibration_per_frame:
            return self._recording.calibration(number), self._calibration_path
        path = self._path(Stream.CALIBRATION, number, result)
        if path is None:
            return None, self._calibration_path
        text = result.try_read(Stream.CALIBRATION, path, lambda: STORE.read_text(path))
        # The frames of a day have equal files.
        known = self._known.get(text or '')
        if known is not None or text is None:
            return known, path
        cameras = [
            camera for stream, camera in self._cameras.items() if number in self._numbers[stream]
        ]
        try:
            calibration = parse_calibration(text, path, path.name)
        except BadFileError as error:
            calibration = no_calibration(str(error))
        file = CalibrationFile(calibration, path, cameras)
        breaches = list(find_breaches(CALIBRATION_RULES, file))
        result.found += breaches
        if not breaches and len(self._known) < _MOST_KNOWN:
            self._known[text] = calibration
        return calibration, path

    def _check_labels(
        self, number: int, result: FrameResult
    ) -> tuple[list[LabelLine], list[Cuboid], Path]:
        if self._tracking is not None:
            return self._tracking.by_frame.get(number, []), [], self._tracking.path
        if number in self._tracklet_numbers:
            return self._check_tracklets(number, result)
        path = self._path(Stream.LABELS, number, result)
        if path is None:
            return [], [], self._calibration_path
        file = result.try_read(
            Stream.LABELS, path, lambda: LabelFile.parse(STORE.read_text(path), path)
        ) or LabelFile.parse('', path)
        result.found += find_breaches(LABEL_RULES, file)
        return list(file.lines), [], path

    def _check_tracklets(
        self, number: int, result: FrameResult
    ) -> tuple[list[LabelLine], list[Cuboid], Path]:
        path = self._recording.path(Stream.LABELS, number)
        labels = self._recording.read(Stream.LABELS, number)
        if not isinstance(labels, FrameLabels):
            return [], [], path
        result.found += find_breaches(TRACKLET_RULES, TrackletFrame(path, labels))
        return [], list(labels.cuboids), path
