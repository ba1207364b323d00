# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The protocol that the reader of every layout follows, and what it is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from .geometry import Float64Array, Transform
    from .losses import Loss
    from .samples import Calibration, Description, Int64Array, Sample, Trajectory, Turn
    from .streams import Clock, Layout, Stream


@dataclass(frozen=True, eq=False)
class Start:
    """The first readable pose of a recording; it decides where map is.

    Attributes:
        world_T_imu: The pose, in the reader's fixed frame.
        level: Whether the axes of that frame are east, north and up; False where the layout has no
            gravity (odometry).
    """

    world_T_imu: Transform
    level: bool


@dataclass(frozen=True, eq=False)
class StreamIndex:
    """Which samples a stream holds: file numbers, ascending, and their stamps, of one length."""

    numbers: Int64Array
    stamps_ns: Int64Array

    def __len__(self) -> int:
        return len(self.numbers)


class Recording(Protocol):
    """A KITTI recording open for reading: an index in memory, samples read one by one on demand.

    Attributes:
        layout: Which of the four layouts.
        name: A short name for people (drive, sequence or folder).
        root: The folder that the names of its text files are relative to.
        streams: What is there; a stream without a single sample is absent.
        cameras: Camera index to the camera's topic name part, such as color_left.
        image_topic: image_rect, or image_raw where the images are not rectified.
        common_numbers: Whether the same number is the same moment in all streams.
        turns: When each scan was made, by file number.
        clock: The meaning of its stamps.
        losses: What the listing already shows to be missing or unusable.
        notes: What is worth a word and no loss, such as a stream that is absent.
    """

    layout: Layout
    name: str
    root: Path

    @property
    def streams(self) -> Mapping[Stream, StreamIndex]:
        """What is there, by stream."""
        ...

    @property
    def cameras(self) -> Mapping[int, str]:
        """Camera index to the name in its topics and frames."""
        ...

    image_topic: str
    common_numbers: bool
    clock: Clock

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number; none of scans compensated for motion."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """What the listing shows to be missing."""
        ...

    @property
    def late_losses(self) -> Sequence[Loss]:
        """What passes over many samples (path, trails, origin of the map) could not read so far.

        Nothing else names it: the sample itself may be left out, or be read at another time.
        """
        ...

    @property
    def notes(self) -> Sequence[str]:
        """What is worth a word and no loss."""
        ...

    def read(self, stream: Stream, number: int) -> Sample:
        """The sample of a stream with a file number.

        Raises:
            BadFileError: The file is cut, malformed or contradicts the rest.
            OSError: The file cannot be read.
        """
        ...

    def path(self, stream: Stream, number: int) -> Path:
        """The file a sample is read from."""
        ...

    def describe(self) -> Description:
        """The recording as a whole."""
        ...

    def calibration(self, number: int) -> Calibration:
        """The calibration that holds for a frame; what it lacks is named in it."""
        ...

    def trails(self, number: int) -> Mapping[int, Float64Array]:
        """Track id to where that track's middle was up to a frame, (N, 3) metres in the world.

        Tracks that the frame does not have are left out; all are, where there are no poses.
        """
        ...

    @property
    def start(self) -> Start | None:
        """The first readable pose of the whole recording, None without one."""
        ...

    def trajectory(self, numbers: Sequence[int]) -> Trajectory:
        """The poses of these numbers, those that cannot be read left out."""
        ...
