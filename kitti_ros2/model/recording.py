# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The protocol of the readers of all layouts, and its parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from .geometry import Float64Array, Transform
    from .layouts import Layout
    from .losses import Loss
    from .motion import Deskew
    from .samples import Calibration, Description, Int64Array, Pose, Sample, Trajectory, Turn
    from .streams import Clock, Stream


@dataclass(frozen=True, eq=False)
class Start:
    """The first readable pose of a recording; it defines the origin of map.

    Attributes:
        world_T_imu: The pose, in the reader's fixed frame.
        level: Whether the axes of that frame are east, north and up; False if the layout has no
            direction of gravity (odometry).
    """

    world_T_imu: Transform
    level: bool


@dataclass(frozen=True, eq=False)
class StreamIndex:
    """The samples of a stream: file numbers, ascending, and their stamps, of the same length."""

    numbers: Int64Array
    stamps_ns: Int64Array

    def __len__(self) -> int:
        return len(self.numbers)


@dataclass(frozen=True)
class FrameOrigin:
    """The frame of a raw drive that a frame of an object set was taken from.

    Attributes:
        drive: The drive, such as 2011_09_26_drive_0005_sync.
        number: Its file number in the drive.
        stamp_ns: Its stamp in the drive, nanoseconds since 1970 UTC: of the scan, or of image_2 in
            a drive without stamps of scans.
    """

    drive: str
    number: int
    stamp_ns: int


class MovingRecording(Protocol):
    """The part of a recording that the motion of its scans is made of.

    Attributes:
        layout: Its layout.
        name: The drive, sequence or split.
        deskew: What was done to its scans; None: they are those of the files.
    """

    layout: Layout
    name: str
    deskew: Deskew | None

    @property
    def streams(self) -> Mapping[Stream, StreamIndex]:
        """Index by stream; a stream without samples is absent."""
        ...

    @property
    def period_ns(self) -> int:
        """Time between frames without stamps, and length of a turn that is not known."""
        ...

    def read(self, stream: Stream, number: int) -> Sample:
        """Read the sample of a stream with a file number.

        Raises:
            BadFileError: The file is truncated, invalid, or contradicts the others.
            OSError: The file cannot be read.
        """
        ...

    def calibration(self, number: int) -> Calibration:
        """Return the calibration of a frame; absent parts are listed in its missing."""
        ...

    def readable_poses(
        self, numbers: Iterable[int], needed_for: Stream
    ) -> Iterator[tuple[int, Pose]]:
        """Yield the poses of these numbers; unreadable ones become losses of a stream."""
        ...


class ReadableRecording(MovingRecording, Protocol):
    """A KITTI recording open for reading: an index in memory, samples read one by one on demand.

    Attributes:
        root: The folder that the names of its text files are relative to.
        image_topic: image_rect, or image_raw for images that are not rectified.
        common_numbers: Whether the same number is the same moment in all streams.
        clock: The meaning of its stamps.
    """

    root: Path

    @property
    def cameras(self) -> Mapping[int, str]:
        """Camera index to the name in its topics and frames, such as color_left."""
        ...

    image_topic: str
    common_numbers: bool
    clock: Clock

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number; scans compensated for motion have none."""
        ...

    @property
    def origins(self) -> Mapping[int, FrameOrigin]:
        """By file number the raw drive's frame of a set in real time; else empty."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """Missing or unusable data found by listing."""
        ...

    @property
    def late_losses(self) -> Sequence[Loss]:
        """Losses so far of passes over many samples (path, trails, origin of the map).

        They are reported nowhere else: the sample itself may be left out, or be read later.
        """
        ...

    @property
    def notes(self) -> Sequence[str]:
        """Remarks that are no loss, such as an absent stream."""
        ...

    def path(self, stream: Stream, number: int) -> Path:
        """Return the file that a sample is read from."""
        ...

    def describe(self) -> Description:
        """Describe the recording as a whole."""
        ...

    def trails(self, number: int) -> Mapping[int, Float64Array]:
        """Map the track ids of a frame to their centres up to it, (N, 3) metres in the world.

        Tracks that the frame does not have are left out; without poses there are none.
        """
        ...

    @property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording, None without one."""
        ...

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """Return the poses of these numbers without the unreadable ones."""
        ...
