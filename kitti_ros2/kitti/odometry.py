# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of the odometry layout: sequences/NN, times relative to its start, and poses/NN.txt.

KITTI has compensated the scans for motion; the time of a point within its turn is not known.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..model.errors import BadFileError
from ..model.layouts import Layout
from ..model.stamps import LAST_NS
from ..model.streams import Clock, Stream
from ..options.read import ScanStamp
from . import names
from .listings import listings_kept
from .poses import pose_from_odometry
from .poses_file import parse_poses
from .recording import KittiRecording
from .semantic_file import parse_point_labels
from .stamps_file import parse_times
from .store import STORE
from .text_file import Lines

if TYPE_CHECKING:
    from pathlib import Path

    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, Pose, Scan
    from ..options.read import ReadOptions


class OdometryRecording(KittiRecording):
    """One sequence of an odometry set."""

    layout = Layout.ODOMETRY
    level_poses = False

    @listings_kept()
    def __init__(self, sequence: Path, options: ReadOptions) -> None:
        grouped = sequence.parent.name == names.SEQUENCES
        super().__init__(
            sequence.parent.parent if grouped else sequence.parent, sequence.name, options
        )
        self.sequence = sequence
        self._times_path = sequence / names.TIMES
        self.clock = Clock.NOMINAL if self._times is None else Clock.RELATIVE
        folders = {Stream.SCAN: (sequence / names.SCANS, (names.BIN,))} | {
            Stream(f'image_{index}'): (sequence / f'image_{index}', names.IMAGE_SUFFIXES)
            for index in range(4)
        }
        self._name_frames(dict(folders.values()), names.FRAME_DIGITS)
        for stream, (folder, suffixes) in folders.items():
            listing = self._list(folder, suffixes)
            if not folder.is_dir():
                self.notes.append(f'{folder}: absent, {stream.value} is left out')
            elif self._times is None:
                self._add_nominal(stream, listing.numbers, listing)
            else:
                self._add_stamped(stream, listing, self._times, self._times_path)
        self._require_common_names()
        self._add_poses()
        labels = sequence / names.POINT_LABELS
        if labels.is_dir() and not options.semantic:
            self.notes.append(f'{labels}: not converted; --semantic takes it')
        if Stream.POSE in self.streams and self.calibration(0).cam0_T_velo is None:
            self.notes.append(f'{self._poses_path}: carried to imu_link by a nominal cam0_T_velo')
        if self._times is None:
            self._find_gaps([*folders, Stream.POSE])
            self.notes.append(f'{self._times_path}: absent; {self._nominal_time}')
        if options.undo_deskew:
            self._add_turns()
        elif Stream.SCAN in self.streams and options.scan_stamp is ScanStamp.START:
            self.notes.append(
                'scans are compensated for motion by KITTI: they have no start of a turn,'
                ' and keep the stamps of their frames'
            )

    @cached_property
    def _times(self) -> Lines[int] | None:
        """The stamps by frame: the epoch of the options plus times.txt."""
        if not self._times_path.is_file():
            return None
        offsets = self._parsed(self._times_path, Stream.SCAN, parse_times)
        epoch = self.options.epoch_ns
        stamps = [None if offset is None else epoch + offset for offset in offsets.values]
        return Lines([s if s is None or s <= LAST_NS else None for s in stamps], offsets.errors)

    @cached_property
    def _poses_path(self) -> Path:
        candidates = (
            self.root / names.POSES / f'{self.sequence.name}{names.TXT}',
            self.sequence / f'{names.POSES}{names.TXT}',
        )
        return next((path for path in candidates if path.is_file()), candidates[0])

    @cached_property
    def _poses(self) -> Lines[Float64Array]:
        return self._parsed(self._poses_path, Stream.POSE, parse_poses)

    def _add_poses(self) -> None:
        if not len(self._poses):
            self.notes.append(f'{self._poses_path}: absent or empty, pose is left out')
            return
        for error in self._poses.errors.values():
            self._lose_lines(Stream.POSE, str(error))
        numbers = list(self._poses.sound())
        if self._times is None:
            self._add_nominal(Stream.POSE, np.array(numbers, dtype=np.int64), None)
            return
        short = list(range(len(self._poses), len(self._times)))
        self._lose(Stream.POSE, short, f'{self._poses_path}: no line for frames {{}}')
        beyond = self._add_at(Stream.POSE, numbers, self._times.values)
        self._lose(Stream.POSE, beyond, f'{self._times_path}: no time for the poses of frames {{}}')

    @cached_property
    def _calibration(self) -> Calibration:
        return self._load_calibration(self.sequence / names.ODOMETRY_CALIB)

    def text_paths(self) -> list[Path]:
        """List the files of times and poses."""
        return [path for path in (self._times_path, self._poses_path) if path.is_file()]

    def _scan(self, number: int) -> Scan:
        scan = super()._scan(number)
        if not self.options.semantic:
            return scan
        name = f'{self._listings[Stream.SCAN].stem(number)}{names.LABEL}'
        path = self.sequence / names.POINT_LABELS / name
        try:
            return replace(
                scan, labels=parse_point_labels(STORE.read(path), len(scan.points), path)
            )
        except FileNotFoundError:
            reason = f'{path}: no such file; its points have label 0'
        except BadFileError as error:
            reason = f'{error}; its points have label 0'
        return replace(scan, labels=np.zeros(len(scan.points), np.uint32), missing={name: reason})

    def _pose(self, number: int) -> Pose:
        matrix = self._poses.values[number]
        if matrix is None:
            raise self._poses.errors[number]
        return pose_from_odometry(matrix, self._calibration)

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        if stream is Stream.CALIBRATION:
            return self.sequence / names.ODOMETRY_CALIB
        return self._poses_path if stream is Stream.POSE else super().path(stream, number)
