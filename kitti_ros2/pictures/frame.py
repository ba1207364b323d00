# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""One frame of a recording or a bag, decoded: what pictures are drawn from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..drawing.objects import LabelledObject
    from ..drawing.pixels import Pixels
    from ..model.losses import Loss
    from ..model.samples import Calibration, Float32Array, Int64Array, OxtsPacket, Pose


@dataclass(frozen=True, eq=False)
class Frame:
    """What belongs to one moment.

    Attributes:
        source: Name of the recording, for people.
        number: KITTI file number; in a bag of others, the place of the frame from 0.
        stamp_ns: Nanoseconds since 1970 of the stream that frames are counted by.
        images: (H, W, 3) uint8 BGR by KITTI camera index, not to be drawn on; grey ones have three
            equal channels.
        points: (N, 4) float32 x y z in metres in velo_link and reflectance 0..1; None without.
        calibration: Of this frame, None where there is none at all.
        objects: Labels.
        predictions: What a detector found, drawn in a second style.
        packet: Of the GPS/IMU unit, if any.
        pose: Where the vehicle is, if known.
        timed: Whether the layout tells times; where it does not, stamps are nominal.
        missing: What cannot be had of this frame and should be there: name to the reason, a line.
    """

    source: str
    number: int
    stamp_ns: int
    images: Mapping[int, Pixels]
    points: Float32Array | None = None
    calibration: Calibration | None = None
    objects: Sequence[LabelledObject] = ()
    predictions: Sequence[LabelledObject] = ()
    packet: OxtsPacket | None = None
    pose: Pose | None = None
    timed: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)


class FrameSource(Protocol):
    """Frames by number; frame may be called from several threads at once.

    Attributes:
        name: For people, such as ``raw 2011_09_26_drive_0005_sync`` or a bag's file name.
        numbers: (N,) int64, ascending.
        stamps_ns: (N,) int64, of the frames.
        cameras: KITTI camera index to name, those that have images.
        losses: What is missing or damaged from the start, by stream or topic.
        cautions: What pictures are to be seen with caution for, such as guessed axes; a line each.
        notes: What else is worth a word and no loss; a line each.
    """

    name: str
    numbers: Int64Array
    stamps_ns: Int64Array
    cameras: Mapping[int, str]
    losses: Sequence[Loss]
    cautions: Sequence[str]
    notes: Sequence[str]

    def frame(self, number: int, wanted: frozenset[str] | None = None) -> Frame:
        """The frame with a number.

        Args:
            number: One of numbers.
            wanted: Streams to read (samples.Stream values such as image_2, scan, labels); all by
                default.

        Raises:
            UsageError: There is no such frame.
        """

    def close(self) -> None:
        """Let go of files."""
