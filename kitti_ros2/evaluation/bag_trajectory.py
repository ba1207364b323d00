# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories in bags: of a topic or a link, and the ground truth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..bags.reader import open_messages
from ..importer.bag_poses import read_track
from ..importer.guess import guess_plan
from ..importer.plan import PosePlan
from ..importer.sensor_rig import SensorRig
from ..importer.survey import survey_bags, survey_sensors
from ..messages.naming import FrameNames
from ..messages.topics import own_topics
from ..model import bag_formats as types
from ..model.errors import (
    KittiRos2Error,
    Loss,
    LossTally,
    MissingDataError,
    UsageError,
    damage,
    did_you_mean,
    some_of,
)
from ..model.geometry import NOMINAL_CAM0_T_VELO, Transform
from ..model.recording import BY_POSITION, StreamIndex
from ..model.samples import default_tolerance_ns
from ..model.streams import Clock, Layout
from ..own_bags.numbering import number_bag
from ..own_bags.recording import BagRecording
from .ground_truth import GroundTruth, StampedFrames, truth_of_recording
from .trajectories import CAMERA_0, CameraTrajectory

if TYPE_CHECKING:
    from ..bags.bag_files import OpenBag
    from ..importer.survey import Survey, TopicSurvey
    from ..options.evaluation import OdometryOptions


# The trajectory of a topic or a link of a bag.

_POSES = (types.ODOMETRY, types.POSE, types.PATH)
_SINGLE_POSE = (types.ODOMETRY, types.POSE)
_SHOWN = 8


def survey_poses(bag: OpenBag) -> Survey:
    """Survey the topics of a bag with poses or transforms.

    Raises:
        BadBagError: It cannot be read.
    """
    with open_messages(bag) as every:
        topics = {name for name, kind in every.channels if kind in {*_POSES, *types.TF_TYPES}}
    return survey_bags([bag], topics)


def choose_result(bag: OpenBag, survey: Survey, options: OdometryOptions) -> PosePlan:
    """Choose the topic or the link of a result by the options.

    Raises:
        UsageError: There is none, or there are several; the message lists the choices.
    """
    if options.tf:
        return _choose_link(bag, survey, options.tf)
    topics = survey.of_type(*_POSES)
    if options.topic is not None:
        chosen = [topic for topic in topics if topic.name == options.topic]
        reason = f'has no poses on {options.topic}'
        reason += did_you_mean(options.topic, [topic.name for topic in topics]).rstrip('?')
    else:
        chosen = [topic for topic in topics if topic.name not in own_topics()] or topics
        reason = 'has several topics with poses' if chosen else 'has no topic with poses'
    if len(chosen) != 1:
        raise UsageError(f'{bag.path}: {reason}; {_choices(survey)}')
    (topic,) = chosen
    return plan_of(topic)


def plan_of(topic: TopicSurvey) -> PosePlan:
    """Return the plan of reading a topic; its body is empty if its messages do not name it."""
    first = topic.samples[0] if topic.samples else None
    body = str(getattr(first, 'child_frame_id', '')).lstrip('/')
    return PosePlan(topic.name, body, topic.frame_id)


def _choose_link(bag: OpenBag, survey: Survey, link: tuple[str, ...]) -> PosePlan:
    parent, child = (name.lstrip('/') for name in link)
    topics = [topic for topic in survey.of_type(*types.TF_TYPES) if 'static' not in topic.name]
    if not topics or (parent, child) not in survey.moving:
        raise UsageError(f'{bag.path}: has no moving link {parent} -> {child}; {_choices(survey)}')
    plain = [topic for topic in topics if topic.name == '/tf']
    return PosePlan((plain or topics)[0].name, child, parent)


def _choices(survey: Survey, other_than: str = '') -> str:
    """List the topics and links that may be a result."""
    others = [topic for topic in survey.of_type(*_POSES) if topic.name != other_than]
    topics = [f'{other.name} ({other.msgtype})' for other in others]
    links = [f'{parent} {child}' for parent, child in survey.moving]
    parts = [f'--topic takes {some_of(topics, _SHOWN)}'] if topics else []
    parts += [f'--tf takes {some_of(links, _SHOWN)}'] if links else []
    return '; '.join(parts) or 'it needs an Odometry, a PoseStamped, a Path or a moving link on /tf'


def read_poses(bag: OpenBag, survey: Survey, plan: PosePlan) -> CameraTrajectory:
    """Read the poses of a topic or link, by stamp.

    Raises:
        UsageError: There is no valid pose.
    """
    tally, topic = LossTally(), survey.topics[plan.topic]
    try:
        track = read_track([bag], plan, survey, tally, child=plan_of(topic).body)
    except UsageError as error:
        raise UsageError(f'{bag.path}: {error}; {_choices(survey, plan.topic)}') from None
    lost = tally.losses()
    losses = [*damage(survey.losses, bag.path.name), *lost]
    twice = topic.count - sum(loss.count for loss in lost) - len(track)
    if topic.msgtype in _SINGLE_POSE and twice:
        losses.append(Loss(plan.topic, twice, f'{plan.topic}: a second pose of the same stamp'))
    reason = topic.stamps()[1] if topic.msgtype in _SINGLE_POSE else None
    notes = [f'{plan.topic}: {reason}'] if reason else []
    is_link = topic.msgtype in types.TF_TYPES
    name = f'{plan.world} -> {plan.body}' if is_link else plan.topic
    poses = [pose.matrix() for pose in track.at(track.stamps_ns) if pose is not None]
    return CameraTrajectory(
        f'{bag.path} ({name})',
        np.array(poses),
        stamps_ns=track.stamps_ns,
        frame=plan.body,
        losses=tuple(losses),
        notes=tuple(notes),
    )


# The ground truth of a trajectory in a bag.


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
    recording = BagRecording(bag, numbered, survey_sensors(bag))
    try:
        epoch_ns = None if recording.clock is Clock.UTC else numbered.source_files.epoch_ns
        return truth_of_recording(recording, recording.base_t_imu, epoch_ns)
    finally:
        recording.close()


def _from_bag(bag: OpenBag, options: OdometryOptions) -> GroundTruth:
    """Read the poses of a bag that to-bag did not write; frames are numbered by position."""
    survey = survey_bags([bag])
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
    trajectory = read_poses(bag, survey, plan.pose)
    notes = [*trajectory.notes, BY_POSITION]
    try:
        body_t_cam0 = SensorRig(plan, survey).body_t_rect()
    except KittiRos2Error as error:
        notes.append(f'camera 0 is taken as at the origin of {plan.pose.body}: {error}')
        body_t_cam0 = Transform(NOMINAL_CAM0_T_VELO.rotation.T, np.zeros(3))
    links = [link for link in survey.static if link[1] != CAMERA_0]
    links.append((plan.pose.body, CAMERA_0, body_t_cam0))
    poses = trajectory.moved(body_t_cam0.matrix()).poses
    numbers = np.arange(len(poses), dtype=np.int64)
    placed = replace(
        trajectory,
        poses=np.linalg.inv(poses[0]) @ poses,
        numbers=numbers,
        frame='',
        notes=tuple(notes),
    )
    frames = None
    if trajectory.stamps_ns is not None:
        samples = StreamIndex(numbers, trajectory.stamps_ns)
        frames = StampedFrames([samples], default_tolerance_ns(trajectory.stamps_ns))
    return GroundTruth(bag.path.stem, placed, frames, links)
