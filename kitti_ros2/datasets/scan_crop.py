# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cuts one scan with the labels of its points, and the labels of its frame that become empty."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import numpy as np

from ..kitti import names
from ..kitti.scan_file import parse_points, parse_rows, parse_scan_text
from ..kitti.semantic_file import format_point_labels, parse_point_labels
from ..kitti.store import STORE
from ..model.errors import KittiRos2Error, describe_error
from ..model.scan_columns import KITTI_COLUMNS
from ..model.streams import Stream
from .camera_view import CameraViews
from .empty_labels import empty_rows, without_rows
from .point_filters import kept_points

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from ..files.hard_links import FilePlacer
    from ..kitti.recording import KittiRecording
    from ..model.samples import Float32Array, FrameLabels
    from ..options.crop import CropOptions
    from .crop_paths import CropPaths, Placed
    from .point_filters import Mask


@dataclass
class CutScan:
    """The result of a frame.

    Attributes:
        number: File number.
        before, after: Number of points.
        done: Whether the scan is written or placed.
        placed: For each unchanged file whether it is a hard link.
        size_bytes: Of new files.
        empty_rows: Lines of the frame's labels that are left out.
        failures: What could not be used: stream and reason.
    """

    number: int
    before: int = 0
    after: int = 0
    done: bool = False
    placed: list[bool] = field(default_factory=list)
    size_bytes: int = 0
    empty_rows: Sequence[int] = ()
    failures: list[tuple[Stream, str]] = field(default_factory=list)


class ScanCropper:
    """Cuts the scans of a recording, in any thread.

    Args:
        recording: The recording.
        options: The filters.
        paths: Its files.
        placer: Places unchanged files.
        root: Folder of the new data set.
    """

    def __init__(
        self,
        recording: KittiRecording,
        options: CropOptions,
        paths: CropPaths,
        placer: FilePlacer,
        root: Path,
    ) -> None:
        self._recording = recording
        self._options = options
        self._paths = paths
        self._placer = placer
        self._root = root
        self._views = CameraViews(recording, options)

    def crop(self, number: int) -> CutScan:
        """Cut a scan; what cannot be used is a failure in the result.

        Raises:
            OSError: The output cannot be written.
        """
        result = CutScan(number)
        path, _ = self._paths.scan(number)
        try:
            scan = _ReadScan.read(path, self._recording)
            keep = kept_points(scan.points, self._options, self._views.at(number))
        except (KittiRos2Error, OSError) as error:
            self._leave_out(result, describe_error(error))
        except ValueError as error:
            self._leave_out(result, f'{path}: {error}')
        else:
            result.before, result.after = len(keep), int(np.count_nonzero(keep))
            if not result.before:
                result.failures.append((Stream.SCAN, f'{path}: the file is empty, and stays so'))
            result.done = self._put(result, self._paths.scan(number), scan.cut, keep)
            self._cut_point_labels(result, keep)
            self._find_empty_labels(result, scan.points[keep])
        self._put_labels(result)
        return result

    def _leave_out(self, result: CutScan, reason: str) -> None:
        """Report a scan that cannot be cut; neither can the labels of its points."""
        labelled = any(path.exists() for path, _ in self._paths.point_labels(result.number))
        too = '; the labels of its points are left out, too' if labelled else ''
        result.failures.append((Stream.SCAN, f'{reason}{too}'))

    def _cut_point_labels(self, result: CutScan, keep: Mask) -> None:
        for paths in self._paths.point_labels(result.number):
            try:
                labels = parse_point_labels(STORE.read(paths[0]), len(keep), paths[0])
            except FileNotFoundError:
                continue
            except (KittiRos2Error, OSError) as error:
                reason = f'{describe_error(error)}; the labels are left out'
                result.failures.append((Stream.LABELS, reason))
            else:
                self._put(result, paths, _cutter(labels), keep)

    def _find_empty_labels(self, result: CutScan, points: Float32Array) -> None:
        if result.number not in self._paths.labelled:
            return
        calibration = self._recording.calibration(result.number)
        try:
            labels = cast('FrameLabels', self._recording.read(Stream.LABELS, result.number))
            result.empty_rows = empty_rows(labels, calibration, points)
        except (KittiRos2Error, OSError) as error:
            result.failures.append((Stream.LABELS, f'{describe_error(error)}; all are kept'))
        except ValueError as error:
            reason = next(iter(calibration.missing.values()), str(error))
            result.failures.append((Stream.LABELS, f'{reason}; all labels are kept'))

    def _put_labels(self, result: CutScan) -> None:
        """Write the labels of the frame without the empty ones."""
        paths = self._paths.frame_labels(result.number)
        if paths is None:
            return
        if not result.empty_rows:
            self._place(result, paths)
            return
        try:
            text = without_rows(STORE.read_text(paths[0]), result.empty_rows)
        except (KittiRos2Error, OSError) as error:
            result.empty_rows = ()
            reason = f'{describe_error(error)}; it is left out'
            result.failures.append((Stream.LABELS, reason))
        else:
            self._write(result, paths, text.encode())

    def _put(
        self, result: CutScan, paths: Placed, cut: Callable[[Mask], bytes], keep: Mask
    ) -> bool:
        """Write a part of a file, or place the file if that is all of it."""
        if keep.all():
            return self._place(result, paths)
        self._write(result, paths, cut(keep))
        return True

    def _place(self, result: CutScan, paths: Placed) -> bool:
        try:
            result.placed.append(self._placer.place(paths[0], self._root / paths[1]))
        except KittiRos2Error as error:
            result.failures.append((Stream.SCAN, f'{error}; it is left out'))
            return False
        return True

    def _write(self, result: CutScan, paths: Placed, data: bytes) -> None:
        STORE.write(self._root / paths[1], data, new=True)
        result.size_bytes += len(data)


@dataclass(frozen=True, eq=False)
class _ReadScan:
    """The points of a scan, and its rows as they are: of a text file its lines."""

    points: Float32Array
    rows: npt.NDArray[np.void] | None = None
    lines: list[bytes] | None = None

    @classmethod
    def read(cls, path: Path, recording: KittiRecording) -> _ReadScan:
        """Read a .bin or a .txt file; an empty one has no points.

        Raises:
            BadFileError: The file is invalid.
            OSError: It cannot be read.
        """
        data = STORE.read_array(path)
        if not len(data):
            return cls(np.empty((0, 4), np.float32))
        if path.suffix != names.TXT:
            recording.check_scan(path, data)
            columns = recording.options.columns or KITTI_COLUMNS
            points = parse_points(data, path, columns).points
            return cls(points, parse_rows(data, path, columns))
        text = data.tobytes()
        lines = text.splitlines(keepends=True)
        return cls(parse_scan_text(text, path), lines=lines)

    def cut(self, keep: Mask) -> bytes:
        """Return the bytes of some points."""
        if self.lines is not None:
            return b''.join(self.lines[row] for row in np.flatnonzero(keep).tolist())
        return b'' if self.rows is None else self.rows[keep].tobytes()


def _cutter(labels: npt.NDArray[np.uint32]) -> Callable[[Mask], bytes]:
    return lambda keep: format_point_labels(labels[keep])
