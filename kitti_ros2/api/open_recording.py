# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A recording opened for reading in Python: frames by number, lazily."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from ..files.remote import as_path, is_remote
from ..files.remote_listing import forget
from ..model.errors import KittiRos2Error, UsageError, describe_error
from ..model.losses import format_numbers
from .frame import Frame
from .source import OpenSource, warn

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator
    from pathlib import Path

    from typing_extensions import Self, Unpack

    from ..model.geometry import Float64Array
    from ..model.losses import Loss
    from ..model.samples import Int64Array
    from .calibration import CalibratedRig
    from .keywords import ReadKeywords


@dataclass(frozen=True, eq=False)
class PoseSeries:
    """The poses of a recording.

    Attributes:
        numbers: (N,) int64, the frames that have a pose.
        stamps_ns: (N,) int64, nanoseconds since 1970 UTC.
        map_T_base: (N, 4, 4) float64, poses of base_link in map, metres.
    """

    numbers: Int64Array
    stamps_ns: Int64Array
    map_T_base: Float64Array


def open(path: str | os.PathLike[str], **options: Unpack[ReadKeywords]) -> Recording:  # noqa: A001
    """Open a KITTI folder (raw, object, odometry, tracking) or a bag (MCAP, sqlite3, ROS 1).

    Frames of a folder, and of a bag written by to-bag, have KITTI's file numbers. Frames of other
    bags are numbered by position, from 0; topics and calibration are detected as by to-kitti.

    Args:
        path: A folder or a bag. Of folders with several drives or sequences, `sequence` chooses
            one.
        options: Options of reading, as on the command line: layout, sequence, columns, epoch,
            semantic, period, scan_stamp, real_time, mapping, raw, deskew, undo_deskew.

    Raises:
        FileNotFoundError: There is no such path; it is a KittiRos2Error as well.
        KittiRos2Error: It is no KITTI folder or bag, or an option is invalid.

    Examples:
        >>> recording = kitti_ros2.open('2011_09_26/2011_09_26_drive_0005_sync')
        >>> recording[0].number, recording[0].points.shape
        (0, (..., 4))
    """
    place = as_path(path)
    if is_remote(place):
        forget(place)  # it may have changed since an earlier call
    source = OpenSource(place, options)
    recording = Recording(source, source.frames.numbers)
    if recording.losses:
        count = len(recording.losses)
        warn(f'{recording.losses[0].text()} (1 of {count}; see losses of the recording)')
    return recording


class Recording(Sequence[Frame]):
    """The frames of a recording, in the order of their numbers; opened by kitti_ros2.open.

    Indices are positions, as in any sequence; `frame(8)` takes KITTI's file number. A slice is a
    recording of fewer frames. Frames are read when their data are used, and nothing is kept:
    iterating holds one frame. Recordings can be pickled, and used in worker processes.
    """

    def __init__(self, source: OpenSource, numbers: Int64Array) -> None:
        self._source = source
        self._numbers = numbers

    @property
    def path(self) -> Path:
        """The folder or bag."""
        return self._source.path

    @property
    def name(self) -> str:
        """Layout and name of the drive, split or sequence, or the file name of a bag."""
        return self._source.frames.name

    @property
    def numbers(self) -> Int64Array:
        """(N,) int64 KITTI file numbers of the frames, ascending; there may be holes."""
        return np.array(self._numbers)

    @property
    def stamps_ns(self) -> Int64Array:
        """(N,) int64 nanoseconds since 1970 UTC; nominal in layouts without time."""
        frames = self._source.frames
        stamps: Int64Array = frames.stamps_ns[np.searchsorted(frames.numbers, self._numbers)]
        return stamps

    @property
    def streams(self) -> dict[str, Int64Array]:
        """The frames that each stream has, by name: scan, image_2, oxts, pose, labels, ..."""
        found = self._source.frames.streams.items()
        return {name: np.intersect1d(numbers, self._numbers) for name, numbers in found}

    @property
    def cameras(self) -> dict[int, str]:
        """KITTI's number of each camera with images, to its name, such as color_left."""
        return dict(self._source.frames.cameras)

    @property
    def losses(self) -> tuple[Loss, ...]:
        """Missing or damaged data, found when it was opened."""
        return tuple(self._source.frames.losses)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks that are no loss, such as assumptions about a bag not written by to-bag."""
        frames = self._source.frames
        return (*frames.assumptions, *frames.notes)

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[Frame]:
        for number in self._numbers.tolist():
            yield Frame(self._source, number)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> Recording: ...

    def __getitem__(self, index: int | slice) -> Frame | Recording:
        if isinstance(index, slice):
            return Recording(self._source, np.sort(self._numbers[index]))
        return Frame(self._source, int(self._numbers[index]))

    def frame(self, number: int) -> Frame:
        """Return the frame with one of KITTI's file numbers.

        Raises:
            KittiRos2Error: There is none.
        """
        if number not in self._numbers:
            have = format_numbers(self._numbers.tolist())
            raise UsageError(f'{self.name} has no frame {number}; it has {have}')
        return Frame(self._source, number)

    def calibration(self) -> CalibratedRig | None:
        """Return the calibration of the first frame, None without any; see Frame.calibration."""
        return self[0].calibration if len(self) else None

    def trajectory(self) -> PoseSeries:
        """Read the poses of all frames; a KittiRos2Warning names those that cannot be read.

        map is east-north-up with its origin at the first base_link position of the whole recording
        (REP-103, REP-105); without gravity (odometry) it is base_link at the first pose.
        """
        numbers, stamps, poses = [], [], []
        for frame in self:
            try:
                pose = frame.pose
            except (KittiRos2Error, OSError) as error:
                warn(describe_error(error))
                continue
            if pose is not None:
                numbers.append(frame.number)
                stamps.append(frame.stamp_ns)
                poses.append(pose)
        return PoseSeries(
            np.array(numbers, np.int64),
            np.array(stamps, np.int64),
            np.array(poses, np.float64).reshape(-1, 4, 4),
        )

    def close(self) -> None:
        """Close the files of a bag; they are opened again when a frame is read."""
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f'<kitti_ros2.Recording {self.name}: {len(self)} frames, {", ".join(self.streams)}>'
