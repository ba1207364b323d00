# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The frames of a bag by name, before any pose is read: which links join them, and which move.

An Odometry is a link from its header's frame to its child frame. It is used where no transform
joins the two (LIO programs often publish no /tf), so the tree stays a tree.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..messages.solid_boxes import frames_in
from ..messages.source import LABEL_LINES
from ..model import msgtypes as types
from ..model.errors import MissingDataError
from ..rig.tf_tree import FrameTree
from .optical_frames import frame_of
from .planned_topics import topic_of
from .survey_types import SOLID

if TYPE_CHECKING:
    from .plan import Plan, PosePlan
    from .survey import Survey
    from .topic_survey import TopicSurvey


@dataclass(frozen=True)
class OdometryLink:
    """An Odometry, or the PoseStamped of a plan, that joins two trees.

    Attributes:
        topic: Its name.
        frame: The frame of its header.
        child: Its child frame.
        root: The root of the child's tree, which becomes a child of the frame.
    """

    topic: str
    frame: str
    child: str
    root: str


class NamedFrames:
    """The links of a bag, without their transforms.

    Attributes:
        odometry: The Odometry topics that are links.
        tree: Static, moving and these links.
        transformed: The frames that transforms name.
    """

    def __init__(self, survey: Survey, pose: PosePlan | None = None) -> None:
        """Take the links of a bag; those of a plan's poses first."""
        self.odometry: list[OdometryLink] = []
        self.tree = survey.tree
        self.transformed = self.tree.frames
        topics = sorted(survey.of_type(types.ODOMETRY), key=lambda each: -each.count)
        planned = survey.topics.get(pose.topic) if pose is not None else None
        if planned is not None and planned.msgtype in (types.ODOMETRY, types.POSE):
            topics = [planned, *(each for each in topics if each is not planned)]
        for topic in topics:
            child = child_of(topic)
            named = pose is not None and topic is planned
            if pose is not None and named and (not child or is_renamed(pose, topic, self)):
                child = pose.body
            link = self._link(topic, child)
            if link is not None:
                if not self.odometry:
                    self.tree = FrameTree(survey.static, survey.moving)
                self.odometry.append(link)
                self.tree.add_moving(link.frame, link.root)

    def _link(self, topic: TopicSurvey, child: str) -> OdometryLink | None:
        """Return an Odometry as a link, None where its frames are joined already or not named."""
        frame = topic.frame
        if not frame or not child or frame == child:
            return None
        if child not in self.tree.frames:
            return OdometryLink(topic.name, frame, child, child)
        root = self.tree.root_of(child)
        if not self.tree.is_root(root):  # of several parents, or in a circle
            return None
        if frame in self.tree.frames and self.tree.root_of(frame) == root:
            return None
        return OdometryLink(topic.name, frame, child, root)

    def moving_between(self, target: str, source: str) -> list[tuple[str, str]] | None:
        """Return (parent, child) of the moving links between two frames, None if not joined."""
        try:
            steps = self.tree.steps(target, source)
        except MissingDataError:
            return None
        return [(above, below) for line in steps for above, below, fixed in line if fixed is None]

    def line_above(self, frame: str) -> list[str]:
        """Return a frame and its ancestors, up to the root."""
        root = self.tree.root_of(frame)
        try:
            _, down = self.tree.steps(root, frame)
        except MissingDataError:
            return [frame]
        return [frame, *(parent for parent, _, _ in reversed(down))]


def child_of(topic: TopicSurvey) -> str:
    """Return the child frame of an Odometry, empty for other types and without one."""
    first = topic.looks[0] if topic.looks else None
    return str(getattr(first, 'child_frame_id', '')).lstrip('/')


def is_renamed(plan: PosePlan, topic: TopicSurvey, names: NamedFrames) -> bool:
    """Whether a topic's poses are of a frame that no transform names, so the plan's body is it."""
    child = child_of(topic)
    renamed = child != plan.body and child not in names.transformed
    return renamed and plan.body in names.transformed


def moving_pairs(plan: Plan, survey: Survey, names: NamedFrames) -> list[tuple[str, str]]:
    """Return the pairs of frames that moving links join, and that scans and labels need.

    Raises:
        UsageError: The plan names a missing topic.
    """
    pairs = []
    base = base_frame(plan, survey)
    if plan.scan is not None:
        clouds = topic_of(survey, plan.scan.topic)
        pairs += [(plan.scan.frame, frame) for frame in clouds.frames]
    if plan.labels is not None and plan.labels.topic != LABEL_LINES and base:
        pairs += [(base, frame) for frame in sorted(_frames_of_boxes(plan.labels.topic, survey))]
    return [pair for pair in pairs if names.moving_between(*pair)]


def base_frame(plan: Plan, survey: Survey) -> str:
    """Return the frame that boxes are brought to: the scans', else that of the first camera."""
    if plan.scan is not None:
        return plan.scan.frame
    with_info = sorted(index for index, camera in plan.cameras.items() if camera.info)
    if not with_info:
        return ''
    first = plan.cameras[with_info[0]]
    return frame_of(first, survey)


def _frames_of_boxes(name: str, survey: Survey) -> set[str]:
    topic = topic_of(survey, name)
    frames = set(topic.frames)
    if topic.msgtype in SOLID:
        for look in topic.looks:
            frames |= frames_in(look)
    return frames
