# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One decoded frame of a recording or a bag, the input of all pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from ..drawing.objects import LabelledObject
    from ..drawing.pixels import Pixels
    from ..model.geometry import Float64Array, Transform
    from ..model.losses import Loss
    from ..model.recording import FrameOrigin
    from ..model.samples import (
        Calibration,
        Float32Array,
        Int64Array,
        OxtsPacket,
        Pose,
        Sample,
        Scan,
    )
    from ..model.streams import Stream

POINT_LABELS = 'point_labels'
"""The name of labels of points among missing data."""


@dataclass(frozen=True, eq=False)
class FrameData:
    """The data of one frame.

    Attributes:
        source: Display name of the recording.
        number: KITTI file number; in a bag not written by to-bag, the index of the frame from 0.
        stamp_ns: Nanoseconds since 1970 of the stream that frames are counted by.
        images: (H, W, 3) uint8 BGR by KITTI camera index, read-only; grey ones have three equal
            channels.
        points: (N, 4) float32 x y z in metres in velo_link and reflectance 0..1; None without.
        point_labels: (N,) SemanticKITTI labels of the points; None without, or if not read.
        calibration: Calibration of this frame, None without any.
        objects: Labels.
        labelled: Whether the frame has labels, possibly none of an object.
        predictions: Objects found by a detector, drawn in a second style.
        packet: Packet of the GPS/IMU unit, if any.
        pose: Pose of the vehicle, if known.
        path: (N, 3) positions of the vehicle up to this frame, in the frame of its pose, metres;
            None without poses, or if not read.
        imaged, scanned: Whether the recording has images and scans, this frame's or others.
        timed: Whether the layout has times; otherwise stamps are nominal.
        missing: Missing or unreadable data of this frame: name to the reason, one line.
    """

    source: str
    number: int
    stamp_ns: int
    images: Mapping[int, Pixels]
    points: Float32Array | None = None
    point_labels: npt.NDArray[np.uint32] | None = None
    calibration: Calibration | None = None
    objects: Sequence[LabelledObject] = ()
    labelled: bool = False
    predictions: Sequence[LabelledObject] = ()
    packet: OxtsPacket | None = None
    pose: Pose | None = None
    path: Float64Array | None = None
    imaged: bool = True
    scanned: bool = True
    timed: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)


class FrameSource(Protocol):
    """Frames by number; frame may be called from several threads at once.

    Attributes:
        name: Display name, such as ``raw 2011_09_26_drive_0005_sync`` or a bag's file name.
        numbers: (N,) int64, ascending.
        stamps_ns: (N,) int64, of the frames.
        streams: Stream name (samples.Stream values) to (N,) int64, the frames that have a sample.
        base_t_imu: imu_link in base_link, or in the body that the poses of a bag are of.
        origins: By number the raw drive's frame of an object set in real time; else empty.
        losses: Data missing or damaged from the start, by stream or topic.
        assumptions: Assumptions that may make pictures wrong, such as guessed axes; one line each.
        notes: Other non-fatal remarks; one line each.
    """

    name: str
    numbers: Int64Array
    stamps_ns: Int64Array
    streams: Mapping[str, Int64Array]
    base_t_imu: Transform
    origins: Mapping[int, FrameOrigin]
    losses: Sequence[Loss]
    assumptions: Sequence[str]
    notes: Sequence[str]

    @property
    def cameras(self) -> Mapping[int, str]:
        """KITTI camera index to name, of cameras with images."""

    def frame(self, number: int, wanted: frozenset[str] | None = None) -> FrameData:
        """Return the frame with a number.

        Args:
            number: One of numbers.
            wanted: Streams to read (samples.Stream values such as image_2, scan, labels); by
                default all but path, which takes the poses of all frames.

        Raises:
            UsageError: The frame does not exist.
        """

    def read(self, stream: Stream, number: int) -> Sample | None:
        """Read one sample of a frame, a pose in map; None if the frame has none.

        Raises:
            KittiRos2Error: It cannot be read.
            OSError: The same.
        """

    def scan_at(self, number: int, stamp_ns: int) -> Scan | None:
        """Read the scan of a frame as at one moment; None if the frame has none.

        Raises:
            MissingDataError: The motion, or the time of the points, is not known.
            KittiRos2Error: It cannot be read.
            OSError: The same.
        """

    def pixels(self, camera: int, number: int) -> Pixels | None:
        """Decode the image of a camera, (H, W, 3) uint8 BGR; None if the frame has none.

        Raises:
            KittiRos2Error: It cannot be decoded.
            OSError: It cannot be read.
        """

    def calibration(self, number: int) -> Calibration | None:
        """Return the calibration of a frame, None without any."""

    def close(self) -> None:
        """Release files."""
