# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth of a trajectory: a poses file, a KITTI folder or a bag."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..bags.locate import locate_bag
from ..bags.open_folder import open_folder
from ..bags.open_source import open_source
from ..bags.reader import OpenBag
from ..importer.apply_calibration import Rigging
from ..importer.guess import guess_plan
from ..importer.survey import glance, look
from ..kitti import names
from ..kitti.poses import rect_from_imu
from ..messages.naming import FrameNames, base_t_imu
from ..model.errors import (
    KittiRos2Error,
    MissingDataError,
    NotABagError,
    UsageError,
    describe_error,
)
from ..model.geometry import Transform
from ..model.layouts import Layout
from ..model.losses import Loss
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..model.recording import MovingRecording
from ..model.samples import Pose
from ..model.streams import Clock, Stream
from ..options.messages import MessageOptions
from ..own_bags.numbering import BY_POSITION, number_bag
from ..own_bags.recording import BagRecording
from .bag_trajectory import plan_of, read_poses
from .rig_frames import CAMERA_0, kitti_links
from .trajectories import CameraTrajectory, read_trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ..kitti.recording import KittiRecording
    from ..options.eval_odometry import OdometryOptions
    from ..options.read import ReadOptions
    from ..rig.tf_tree import Link


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """The true poses of the vehicle, and its frames.

    Attributes:
        name: Sequence or drive, such as 09.
        trajectory: Of camera 0, in its first frame.
        links: Static transforms up to camera 0; empty without a calibration.
        epoch_ns: Stamp of second 0 in recordings without absolute time; None for others.
    """

    name: str
    trajectory: CameraTrajectory
    links: Sequence[Link] = ()
    epoch_ns: int | None = None


def is_text(path: Path) -> bool:
    """Whether a path is a file and no bag.

    Raises:
        BadBagError: It is empty, or no regular file.
        OSError: It cannot be read.
    """
    if not path.is_file():
        return False
    try:
        locate_bag(path)
    except NotABagError:
        return True
    return False


def open_truth(path: Path, read: ReadOptions, options: OdometryOptions) -> GroundTruth:
    """Read a ground truth.

    Raises:
        KittiRos2Error: It cannot be read, or has no poses.
        OSError: It cannot be read.
    """
    source = None if is_text(path) else open_source(path, read)
    if options.gt_topic is not None and not isinstance(source, OpenBag):
        raise UsageError(f'{path}: is no bag; --gt-topic is for a bag')
    if source is None:
        return _from_file(path, read)
    if not isinstance(source, OpenBag):
        return _from_folder(source)
    with source as bag:
        return _from_own_bag(bag, options) or _from_bag(bag, options)


def _from_file(path: Path, read: ReadOptions) -> GroundTruth:
    """Read a poses file; stamps and calibration come from its sequence's folder, if it is there."""
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
        beside = _from_folder(open_folder(folder, replace(read, layout=None, sequence=None)))
    except (KittiRos2Error, OSError):
        return GroundTruth(path.stem, found)
    if beside.trajectory.numbers is None or not np.array_equal(
        beside.trajectory.numbers, found.numbers
    ):
        return GroundTruth(path.stem, found, beside.links)
    timed = replace(found, stamps_ns=beside.trajectory.stamps_ns)
    return replace(beside, name=path.stem, trajectory=timed)


def _from_folder(recording: KittiRecording) -> GroundTruth:
    epoch_ns = None if recording.clock is Clock.UTC else recording.options.epoch_ns
    return _from_recording(recording, base_t_imu(MessageOptions()), epoch_ns)


def _from_own_bag(bag: OpenBag, options: OdometryOptions) -> GroundTruth | None:
    """Read the poses of the recording in a bag that to-bag wrote; None for another bag."""
    if options.gt_topic is not None:
        return None
    numbered = number_bag(bag, bag.index.by_topic())
    if numbered is None:
        return None
    recording = BagRecording(bag, numbered, glance(bag))
    try:
        epoch_ns = None if recording.clock is Clock.UTC else numbered.blueprint.epoch_ns
        return _from_recording(recording, recording.base_t_imu, epoch_ns)
    finally:
        recording.close()


class _PosedRecording(MovingRecording, Protocol):
    """A recording with losses: of a folder, or of a bag."""

    root: Path

    @property
    def losses(self) -> Sequence[Loss]: ...


def _from_recording(
    recording: _PosedRecording, base_t_imu: Transform, epoch_ns: int | None
) -> GroundTruth:
    """Read the poses of imu_link, and convert them to camera 0 in its first frame.

    KITTI's matrices have seven digits. The conversion of poses/NN.txt to imu_link is undone by its
    inverse, not by its transpose, so that the result is poses/NN.txt again.
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
    return GroundTruth(recording.name, found, kitti_links(calibration, base_t_imu), epoch_ns)


def _from_bag(bag: OpenBag, options: OdometryOptions) -> GroundTruth:
    """Read the poses of a bag that to-bag did not write; frames are numbered by position."""
    survey = look([bag])
    plan = guess_plan(survey, Layout.ODOMETRY, bag.path).plan
    if options.gt_topic is not None:
        topic = survey.topics.get(options.gt_topic)
        if topic is None or not topic.count:
            raise UsageError(f'{bag.path}: has no messages on {options.gt_topic}')
        named = plan_of(topic)
        plan = replace(plan, pose=replace(named, body=named.body or FrameNames().base))
    if plan.pose is None:
        raise MissingDataError(
            f'{bag.path}: has no poses; a ground truth in a bag is an Odometry, a PoseStamped, a'
            f' Path or a moving link of base_link'
        )
    found = read_poses(bag, survey, plan.pose)
    notes = [*found.notes, BY_POSITION]
    try:
        body_t_cam0 = Rigging(plan, survey).body_t_rect()
    except KittiRos2Error as error:
        notes.append(f'camera 0 is taken as at the origin of {plan.pose.body}: {error}')
        body_t_cam0 = Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))
    links = [link for link in survey.static if link[1] != CAMERA_0]
    links.append((plan.pose.body, CAMERA_0, body_t_cam0))
    poses = found.moved(body_t_cam0.matrix()).poses
    placed = replace(
        found,
        poses=np.linalg.inv(poses[0]) @ poses,
        numbers=np.arange(len(poses), dtype=np.int64),
        frame='',
        notes=tuple(notes),
    )
    return GroundTruth(bag.path.stem, placed, links)
