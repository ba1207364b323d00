# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth of a trajectory: a poses file, or a KITTI folder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..kitti import names
from ..kitti.layouts import open_recording
from ..kitti.poses import rect_from_imu
from ..messages.naming import base_t_imu
from ..model.errors import (
    KittiRos2Error,
    MissingDataError,
    UsageError,
    describe_error,
)
from ..model.losses import Loss
from ..model.recording import MovingRecording
from ..model.samples import Pose
from ..model.streams import Clock, Stream
from ..options.messages import MessageOptions
from .frame_stamps import posed_frames_of
from .rig_frames import kitti_links
from .trajectories import CameraTrajectory, read_trajectory

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..model.geometry import Transform
    from ..model.samples import Turn
    from ..options.read import ReadOptions
    from ..rig.tf_tree import Link
    from .frame_stamps import StampedFrames


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The true poses of the vehicle, and its frames.

    Attributes:
        name: Sequence or drive, such as 09.
        trajectory: Of camera 0, in its first frame.
        frames: Its frames by stamp; None without stamps.
        links: Static transforms up to camera 0; empty without a calibration.
        epoch_ns: Stamp of second 0 in recordings without absolute time; None for others.
    """

    name: str
    trajectory: CameraTrajectory
    frames: StampedFrames | None = None
    links: Sequence[Link] = ()
    epoch_ns: int | None = None


def truth_of_file(path: Path, read: ReadOptions) -> GroundTruth:
    """Read a poses file; stamps and calibration are read from the folder of its sequence, if any.

    Raises:
        KittiRos2Error: It holds no poses.
        OSError: It cannot be read.
    """
    found = read_trajectory(path)
    if found.numbers is None:
        raise UsageError(
            f'{path}: is a TUM file; as ground truth give a poses file of KITTI, the folder of a'
            f' sequence or drive, or a bag'
        )
    folder = path.parent.parent / names.SEQUENCES / path.stem
    if path.parent.name != names.POSES or not folder.is_dir():
        return GroundTruth(path.stem, found)
    try:
        beside = truth_of_folder(open_recording(folder, replace(read, layout=None, sequence=None)))
    except (KittiRos2Error, OSError):
        return GroundTruth(path.stem, found)
    if beside.trajectory.numbers is None or not np.array_equal(
        beside.trajectory.numbers, found.numbers
    ):
        return GroundTruth(path.stem, found, links=beside.links)
    timed = replace(found, stamps_ns=beside.trajectory.stamps_ns)
    return replace(beside, name=path.stem, trajectory=timed)


def truth_of_folder(recording: KittiRecording) -> GroundTruth:
    """Read the poses of a KITTI folder.

    Raises:
        MissingDataError: It has none.
    """
    epoch_ns = None if recording.clock is Clock.UTC else recording.options.epoch_ns
    return truth_of_recording(recording, base_t_imu(MessageOptions()), epoch_ns)


class PosedRecording(MovingRecording, Protocol):
    """A recording with losses: of a folder, or of a bag."""

    root: Path
    common_numbers: bool

    @property
    def turns(self) -> Mapping[int, Turn]:
        """The turn of each scan, by file number."""
        ...

    @property
    def losses(self) -> Sequence[Loss]:
        """Missing or damaged data."""
        ...


def truth_of_recording(
    recording: PosedRecording, base_t_imu: Transform, epoch_ns: int | None
) -> GroundTruth:
    """Read the poses of imu_link, and convert them to camera 0 in its first frame.

    KITTI's matrices have seven digits. The conversion of poses/NN.txt to imu_link is undone by its
    inverse, not by its transpose, so that the result is poses/NN.txt again.

    Raises:
        MissingDataError: It has no poses.
    """
    index = recording.streams.get(Stream.POSE)
    if index is None:
        raise MissingDataError(
            f'{recording.root}: {recording.name} has no poses; the ground truth is poses/NN.txt of'
            f' odometry, or oxts of raw drives and tracking'
        )
    calibration = recording.calibration(int(index.numbers[0]))
    imu_t_cam0 = np.linalg.inv(rect_from_imu(calibration).matrix())
    nominal = list(calibration.nominal) if Stream.OXTS in recording.streams else []
    if calibration.cam0_T_velo is None:
        nominal.append('cam0_T_velo')
    about = {Stream.POSE.value, recording.root.name}
    losses = [loss for loss in recording.losses if loss.stream in about]
    kept, poses = [], []
    for place, number in enumerate(index.numbers.tolist()):
        try:
            pose = recording.read(Stream.POSE, number)
        except (KittiRos2Error, OSError) as error:
            losses.append(Loss(Stream.POSE.value, 1, describe_error(error)))
            continue
        if isinstance(pose, Pose):
            kept.append(place)
            poses.append(pose.world_T_imu.matrix() @ imu_t_cam0)
    if not poses:
        raise MissingDataError(f'{recording.root}: no pose can be read; {losses[0].text()}')
    found = CameraTrajectory(
        f'{recording.root} ({recording.layout.value} {recording.name})',
        np.linalg.inv(poses[0]) @ np.array(poses),
        index.numbers[kept],
        index.stamps_ns[kept],
        losses=tuple(losses),
        notes=tuple(f'{part}: not known, a nominal value is used' for part in nominal),
    )
    links = kitti_links(calibration, base_t_imu)
    return GroundTruth(recording.name, found, posed_frames_of(recording), links, epoch_ns)
