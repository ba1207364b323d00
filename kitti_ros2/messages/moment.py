# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The context of a conversion between a sample and its messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..files.image_files import decode_image
from ..model.geometry import Transform
from ..model.streams import Stream
from .map_frame import map_from_world
from .naming import FrameNames, base_t_imu, naming_of, with_ground_truth_tree

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path, PurePath

    from ..model.geometry import Float64Array
    from ..model.recording import ReadableRecording
    from ..model.samples import Calibration, FrameLabels, Image
    from ..options.messages import MessageOptions
    from .pixels import Pixels

LABELLED_CAMERA = 2
"""The camera of KITTI's labels: the left colour camera."""


@dataclass(frozen=True)
class Rig:
    """The parameters common to all messages of a recording.

    Attributes:
        frames: Frame names.
        cameras: Those whose images or labels are in messages.
        base_t_imu: imu_link in base_link.
        map_T_world: The fixed frame of the reader's poses in map.
        options: Of the messages.
        tracked: Whether labels have tracks.
    """

    frames: FrameNames
    cameras: frozenset[int]
    base_t_imu: Transform
    map_T_world: Transform
    options: MessageOptions
    tracked: bool = False


@dataclass(frozen=True)
class Moment:
    """The context of an encoder besides its sample.

    Attributes:
        rig: The parameters common to all messages.
        stamp_ns: The sample's own.
        path: Its file, for errors.
        calibration: Returns the calibration of the sample's frame.
        trails: Returns the earlier positions of the tracks in the sample's frame, in the reader's
            fixed frame.
        camera: KITTI camera index of an image.
        pixels: Decodes an image.
        labels: Returns the labels of the sample's frame; None if it is not labelled.
        predictions: Returns the predictions of the sample's frame; None without any.
        remark: Called with a remark on values of the messages that are estimated.
    """

    rig: Rig
    stamp_ns: int
    path: Path
    calibration: Callable[[], Calibration]
    trails: Callable[[], Mapping[int, Float64Array]]
    camera: int = 0
    pixels: Callable[[Image], Pixels] = decode_image
    labels: Callable[[], FrameLabels | None] = lambda: None
    predictions: Callable[[], FrameLabels | None] = lambda: None
    remark: Callable[[str], None] = lambda _: None

    @property
    def at_imu(self) -> tuple[int, str]:
        """Stamp and frame of the messages of a packet."""
        return self.stamp_ns, self.rig.frames.imu


@dataclass(frozen=True)
class Origin:
    """The context of a decoder besides its message.

    Attributes:
        path: The bag, or the file that is made of the message, for errors.
        base_t_imu: imu_link in base_link, for poses.
    """

    path: PurePath
    base_t_imu: Transform = field(default_factory=Transform.identity)


def make_rig(recording: ReadableRecording, options: MessageOptions) -> Rig:
    """Make the parameters common to all messages of a recording."""
    mount = base_t_imu(options)
    boxed = {Stream.LABELS, Stream.PREDICTIONS} & recording.streams.keys()
    labelled = {LABELLED_CAMERA} if boxed else set()
    return Rig(
        frames=with_ground_truth_tree(naming_of(options).frames_of(recording.cameras), options),
        cameras=frozenset(recording.cameras) | labelled,
        base_t_imu=mount,
        map_T_world=map_from_world(recording.start, mount, options.map),
        options=options,
        tracked=recording.layout.traits.common_labels,
    )
