# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth of a trajectory in a bag."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..importer.apply_calibration import Rigging
from ..importer.guess import guess_plan
from ..importer.survey import glance, look
from ..importer.sync import default_tolerance_ns
from ..messages.naming import FrameNames
from ..messages.topics import own_topics
from ..model.errors import KittiRos2Error, MissingDataError, UsageError
from ..model.geometry import Transform
from ..model.layouts import Layout
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..model.recording import StreamIndex
from ..model.streams import Clock
from ..own_bags.numbering import BY_POSITION, number_bag
from ..own_bags.recording import BagRecording
from .bag_trajectory import plan_of, read_poses
from .frame_stamps import StampedFrames
from .ground_truth_poses import GroundTruth, truth_of_recording
from .rig_frames import CAMERA_0

if TYPE_CHECKING:
    from ..bags.reader import OpenBag
    from ..options.eval_odometry import OdometryOptions


def truth_of_bag(bag: OpenBag, options: OdometryOptions) -> GroundTruth:
    """Read the poses of the recording in a bag, or of a topic.

    Raises:
        KittiRos2Error: It has none.
    """
    return _from_own_bag(bag, options) or _from_bag(bag, options)


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
        return truth_of_recording(recording, recording.base_t_imu, epoch_ns)
    finally:
        recording.close()


def _from_bag(bag: OpenBag, options: OdometryOptions) -> GroundTruth:
    """Read the poses of a bag that to-bag did not write; frames are numbered by position."""
    survey = look([bag])
    plan = guess_plan(survey, Layout.ODOMETRY, bag.path).plan
    if options.gt_topic is not None:
        topic = survey.topics.get(options.gt_topic)
        if topic is None or not topic.count:
            raise UsageError(f'{bag.path}: has no messages on {options.gt_topic}')
        named = plan_of(topic)
        body = '' if topic.name in own_topics() else named.body
        plan = replace(plan, pose=replace(named, body=body or FrameNames().base))
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
    numbers = np.arange(len(poses), dtype=np.int64)
    placed = replace(
        found,
        poses=np.linalg.inv(poses[0]) @ poses,
        numbers=numbers,
        frame='',
        notes=tuple(notes),
    )
    frames = None
    if found.stamps_ns is not None:
        samples = StreamIndex(numbers, found.stamps_ns)
        frames = StampedFrames([samples], default_tolerance_ns(found.stamps_ns))
    return GroundTruth(bag.path.stem, placed, frames, links)
