# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writer of the odometry layout: sequences/NN and poses/NN.txt."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from ..model.errors import UsageError
from ..model.layouts import Layout
from . import names
from .calib_file import format_odometry
from .poses_file import format_poses
from .semantic_file import format_point_labels
from .stamps_file import format_times
from .store import STORE
from .writer import LayoutWriter, require_next

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, Scan


class OdometryWriter(LayoutWriter):
    """Writes one sequence. File numbers run from 0 without a gap: times and poses are by line.

    Args:
        root: The dataset folder, above sequences and poses.
        sequence: The sequence's number.
    """

    layout: ClassVar[Layout] = Layout.ODOMETRY

    def __init__(self, root: Path, sequence: int = 0) -> None:
        name = f'{sequence:02d}'
        self.path = root / names.SEQUENCES / name
        self._poses_path = root / names.POSES / f'{name}{names.TXT}'
        self._poses: list[Float64Array] = []
        self._stamps: dict[int, int] = {}

    def write_scan(self, number: int, stamp_ns: int, scan: Scan) -> None:
        """Write velodyne/NNNNNN.bin, and labels/NNNNNN.label if its points have labels."""
        self._stamps.setdefault(number, stamp_ns)
        super().write_scan(number, stamp_ns, scan)
        if scan.labels is not None:
            path = self._file(names.POINT_LABELS, number, names.LABEL)
            STORE.write(path, format_point_labels(scan.labels))

    def write_image(self, camera: int, number: int, stamp_ns: int, png: bytes) -> None:
        """Write image_C/NNNNNN.png; the benchmark's times are those of camera 0."""
        super().write_image(camera, number, stamp_ns, png)
        if camera == 0:
            self._stamps[number] = stamp_ns
        self._stamps.setdefault(number, stamp_ns)

    def write_pose(self, number: int, stamp_ns: int, first_T_cam0: Float64Array) -> None:
        """Write a line of poses/NN.txt.

        Raises:
            UsageError: The number is not the next one.
        """
        require_next(self._poses_path, 'pose', len(self._poses), number)
        self._stamps.setdefault(number, stamp_ns)
        self._poses.append(first_T_cam0)

    def close(self) -> None:
        """Write times.txt and poses/NN.txt.

        Raises:
            UsageError: A frame number is missing.
        """
        missing = next((n for n in range(len(self._stamps)) if n not in self._stamps), None)
        if missing is not None:
            raise UsageError(
                f'{self.path / names.TIMES}: line n is frame n, and there is no frame {missing};'
                f' number the frames from 0 without a gap'
            )
        offsets = [self._stamps[number] - self._stamps[0] for number in sorted(self._stamps)]
        STORE.write_text(self.path / names.TIMES, format_times(offsets))
        if self._poses:
            STORE.write_text(self._poses_path, format_poses(self._poses))

    def _calibration_path(self, number: int) -> Path:  # noqa: ARG002 - one for the sequence
        return self.path / names.ODOMETRY_CALIB

    def _format_calibration(self, calibration: Calibration) -> str:
        return format_odometry(calibration)
