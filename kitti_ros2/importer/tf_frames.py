# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The TF frames of a bag: by name, KITTI's velodyne frame, and where frames are at a stamp."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..messages.cdr import stamp_ns_of
from ..messages.tf_tree import (
    AXES,
    FIXED_FRAMES,
    FrameTree,
    Heading,
    describe_direction,
    is_optical,
    nearest_axis,
)
from ..model import bag_formats as types
from ..model.errors import MissingDataError
from ..model.geometry import Transform
from .plan import X_FORWARD
from .survey import topic_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from collections.abc import Set as AbstractSet

    from ..messages.moving_tree import MovingTree
    from ..messages.tf_tree import Link
    from ..model.geometry import Float64Array
    from .plan import CameraPlan, Plan, PosePlan, ScanPlan
    from .survey import Survey, TopicSurvey


# Topics and frames by their names.

_FIXED = frozenset({*FIXED_FRAMES, 'enu', 'utm', 'local', 'local_origin'})
_TRUTH = re.compile(r'ground_truth|groundtruth|\bgt\b', re.IGNORECASE)


def is_truth(topic: str) -> bool:
    """Return whether a topic is called ground truth."""
    return bool(_TRUTH.search(topic))


def is_fixed(frame_id: str) -> bool:
    """Return whether a frame has the name of one in which robots move."""
    return frame_id.rpartition('/')[2].lower() in _FIXED


# The frames of a bag by name, before any pose is read: which links join them, and which move.
#
# An Odometry is a link from its header's frame to its child frame. It is used where no transform
# joins the two (LIO programs often publish no /tf), so the tree stays a tree.


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
        topics = sorted(survey.of_type(types.ODOMETRY), key=lambda odometry: -odometry.count)
        planned = survey.topics.get(pose.topic) if pose is not None else None
        if planned is not None and planned.msgtype in (types.ODOMETRY, types.POSE):
            topics = [planned, *(odometry for odometry in topics if odometry is not planned)]
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
        frame_id = topic.frame_id
        if not frame_id or not child or frame_id == child:
            return None
        if child not in self.tree.frames:
            return OdometryLink(topic.name, frame_id, child, child)
        root = self.tree.root_of(child)
        if not self.tree.is_root(root):  # of several parents, or in a circle
            return None
        if frame_id in self.tree.frames and self.tree.root_of(frame_id) == root:
            return None
        return OdometryLink(topic.name, frame_id, child, root)

    def moving_between(self, target: str, source: str) -> list[tuple[str, str]] | None:
        """Return (parent, child) of the moving links between two frames, None if not joined."""
        try:
            steps = self.tree.steps(target, source)
        except MissingDataError:
            return None
        return [(above, below) for line in steps for above, below, fixed in line if fixed is None]

    def line_above(self, frame_id: str) -> list[str]:
        """Return a frame and its ancestors, up to the root."""
        root = self.tree.root_of(frame_id)
        try:
            _, down = self.tree.steps(root, frame_id)
        except MissingDataError:
            return [frame_id]
        return [frame_id, *(parent for parent, _, _ in reversed(down))]


def child_of(topic: TopicSurvey) -> str:
    """Return the child frame of an Odometry, empty for other types and without one."""
    first = topic.samples[0] if topic.samples else None
    return str(getattr(first, 'child_frame_id', '')).lstrip('/')


def is_renamed(plan: PosePlan, topic: TopicSurvey, names: NamedFrames) -> bool:
    """Return whether a topic's poses are of a frame without transforms: the body replaces it."""
    child = child_of(topic)
    renamed = child != plan.body and child not in names.transformed
    return renamed and plan.body in names.transformed


# Optical frames of cameras whose own frame has x forward and z up.
#
# A CameraInfo is for an optical frame, z forward, x right, y down (REP 103,
# sensor_msgs/CameraInfo). Simulators and exporters often name the body of the camera; the optical
# frame is one more static link then, so that calibration, labels and poses agree.

LINK_T_OPTICAL = Transform(AXES['z'].T.copy(), np.zeros(3))
"""The optical frame in such a frame."""


def optical_name(frame_id: str, forward: str) -> str:
    """Return the name of the optical frame of a camera's frame: itself, or the made one."""
    return f'{frame_id} with {forward} forward, optical' if forward else frame_id


def frame_of(camera: CameraPlan, survey: Survey) -> str:
    """Return the frame that a camera of a plan has in the bag.

    Raises:
        UsageError: The plan names a missing topic.
    """
    return camera.frame or topic_of(survey, camera.info).frame_id


def optical_link(frame_id: str, forward: str) -> Link:
    """Return the link from a frame with x forward to its optical frame."""
    return frame_id, optical_name(frame_id, forward), LINK_T_OPTICAL


def optical_links(plan: Plan, survey: Survey) -> list[Link]:
    """Return the links to the optical frames that a plan has made.

    Raises:
        UsageError: The plan names a missing topic.
    """
    cameras: Iterable[CameraPlan] = plan.cameras.values()
    frame_ids = {frame_of(camera, survey) for camera in cameras if camera.forward and camera.info}
    return [optical_link(frame_id, X_FORWARD) for frame_id in sorted(frame_ids)]


# Frames with x forward, y left, z up, as KITTI's velodyne and imu frames are.

_FORWARD = np.cos(np.radians(30))
_LEVEL = np.cos(np.radians(3))
_SAME_ORIGIN_M = 0.1


def face_forward(
    scan: ScanPlan, tree: FrameTree, heading: Heading | None, notes: list[str]
) -> ScanPlan:
    """Return the plan of the scans with x forward, and note a change.

    Args:
        scan: With the frame of the messages.
        tree: The static transforms.
        heading: The robot's forward; None where it is unknown.
        notes: A note is added.
    """
    if heading is not None and heading.assumed:
        notes.append(
            f'x of {scan.frame} is taken as forward: no static transform joins it to base_link or a'
            f' front camera; scan.forward of the plan corrects it'
        )
        return scan
    axes = None if heading is None else heading.axes_of(tree, scan.frame)
    if heading is None or axes is None or (is_forward(axes) and not _leans(axes, heading)):
        return scan
    text = f'{scan.topic} is in {scan.frame}, '
    if is_optical(scan.frame):
        text += 'z forward'
    elif is_forward(axes):
        lean = np.degrees(np.arccos(np.clip(axes[2, 2], -1, 1)))
        text += f'whose z leans by {lean:.0f} degrees (up is z of {heading.frame})'
    else:
        text += describe_axes(axes, heading)
    text += '; KITTI has x forward and z up'
    near = near_frame(scan.frame, tree, heading)
    if near:
        notes.append(f'{text}: scan.frame is {near}')
        return replace(scan, frame=near)
    forward = heading.frame if heading.body else nearest_axis(axes.T)
    if forward == 'x':
        return scan
    of = f'x of {forward}' if heading.body else f'{forward} of {scan.frame}'
    notes.append(f'{text}: the scans are turned so that x is {of} (scan.forward)')
    return replace(scan, forward=forward)


def describe_axes(axes: Float64Array, heading: Heading) -> str:
    """Describe the axes of a frame, as columns in forward, left, up, that is not forward."""
    up = '' if is_up(axes) else ' and z not up'
    return f'whose x looks {describe_direction(axes[:, 0])}{up} (forward is {heading.source})'


def is_forward(axes: Float64Array) -> bool:
    """Return whether the axes of a frame, as columns in forward, left, up, are about these."""
    return bool(axes[0, 0] >= _FORWARD and is_up(axes))


def _leans(axes: Float64Array, heading: Heading) -> bool:
    """Return whether boxes that are upright on the ground lean in the scans: see TrackletPose."""
    return heading.body and bool(axes[2, 2] < _LEVEL)


def is_up(axes: Float64Array) -> bool:
    """Return whether z of a frame, whose axes are columns in forward, left, up, is about up."""
    return bool(axes[2, 2] >= _FORWARD)


def forward_frame(frame_id: str, tree: FrameTree, heading: Heading) -> str:
    """Return the body's frame, or the one next to a frame, that has x forward; '' without one."""
    candidates = []
    for other in tree.frames:
        frame_t_other, axes = tree.find(frame_id, other), heading.axes_of(tree, other)
        if frame_t_other is None or axes is None or not is_forward(axes) or _leans(axes, heading):
            continue
        if other == heading.frame and heading.body:
            return other
        candidates.append((float(np.linalg.norm(frame_t_other.translation)), other))
    return min(candidates)[1] if candidates else ''


def near_frame(frame_id: str, tree: FrameTree, heading: Heading) -> str:
    """Return a parent or child of a frame with its origin and x forward, '' without one."""
    candidates = []
    for other in tree.neighbours(frame_id):
        frame_t_other, axes = tree.find(frame_id, other), heading.axes_of(tree, other)
        if frame_t_other is None or axes is None or not is_forward(axes) or _leans(axes, heading):
            continue
        distance = float(np.linalg.norm(frame_t_other.translation))
        if distance <= _SAME_ORIGIN_M:
            candidates.append((distance, other))
    return min(candidates)[1] if candidates else ''


# velo_T_frame of the frames of clouds and boxes, also of those that the vehicle moves in.
#
# Boxes in map or odom stand in the world: they are placed by the vehicle's pose at the stamp of the
# scan that they are assigned to, so that a parked car lies on its points whatever the stamp of its
# box. Detectors give their output the stamp of the scan that it was made of, which may be the start
# of a turn while the scan is stamped in the middle; their boxes came into the world by the pose at
# that stamp, and are brought back by it. Boxes in a frame that moves are placed at their own stamp.
#
# Where clouds are in such a frame themselves, each is brought to the vehicle at its stamp, which
# may be in the middle of a turn. Boxes go the same way: also those in a frame of the vehicle are
# placed in the frame of the clouds at their own stamp, then brought to it at the stamp of the
# cloud.


@dataclass(frozen=True, eq=False)
class MovingBase:
    """A frame of the vehicle, and the links that join it to frames that it moves in.

    Attributes:
        frame: The frame, fixed to the vehicle.
        velo_T_frame: Its pose in KITTI's velodyne frame.
        tree: The links over time; None where no message needs them.
        world: The frame of clouds that the vehicle moves in; empty where clouds are fixed to it.
    """

    frame: str
    velo_T_frame: Transform
    tree: MovingTree | None = None
    world: str = ''


class BoxTimes(NamedTuple):
    """When the boxes of a message are placed.

    Attributes:
        own_ns: The stamp of the message.
        scan_ns: The stamp of its scan, which may be the middle of a turn; None for own_ns.
        moved_ns: The way there from the stamp of the scan's header, if the message has this stamp.
    """

    own_ns: int
    scan_ns: int | None = None
    moved_ns: int = 0


class UnknownTransformError(ValueError):
    """The transform of a frame is unknown at a stamp.

    Attributes:
        stamp_ns: The stamp, which differs from the log time of the message.
    """

    def __init__(self, reason: str, stamp_ns: int) -> None:
        super().__init__(reason)
        self.stamp_ns = stamp_ns


class StaticFrames(Mapping[str, 'Transform']):
    """velo_T_frame of the frames that static transforms join, computed when one is looked up.

    Args:
        tree: The static transforms.
        base: A frame of them, or one of its own.
    """

    def __init__(self, tree: FrameTree, base: MovingBase) -> None:
        self._tree = tree
        self._base = base
        self._cache: dict[str, Transform | None] = {base.frame: base.velo_T_frame}

    def _find(self, name: object) -> Transform | None:
        if not isinstance(name, str) or (name not in self._cache and name not in self._frames):
            return None
        if name not in self._cache:
            base_t_frame = self._tree.find(self._base.frame, name)
            joined = None if base_t_frame is None else self._base.velo_T_frame @ base_t_frame
            self._cache[name] = joined
        return self._cache[name]

    @property
    def _frames(self) -> AbstractSet[str]:
        return self._tree.frames

    def __contains__(self, name: object) -> bool:
        return self._find(name) is not None

    def __getitem__(self, name: str) -> Transform:
        transform = self._find(name)
        if transform is None:
            raise KeyError(name)
        return transform

    def __iter__(self) -> Iterator[str]:
        names = self._frames | {self._base.frame}
        return (name for name in names if name in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)


class FramesAt(Mapping[str, 'Transform']):
    """velo_T_frame by name at a stamp; a look-up raises UnknownTransformError if it is unknown.

    Args:
        joined: The frames that static transforms join.
        base: For the others.
        times: When the message and its scan are placed.
    """

    def __init__(self, joined: Mapping[str, Transform], base: MovingBase, times: BoxTimes) -> None:
        self._joined = joined
        self._base = base
        self._own_ns = self._scan_ns = times.own_ns
        if times.scan_ns is not None:
            self._scan_ns = times.scan_ns - (0 if base.world else times.moved_ns)

    def __contains__(self, name: object) -> bool:
        tree = self._base.tree
        return name in self._joined or (
            tree is not None and isinstance(name, str) and tree.joins(self._base.frame, name)
        )

    def __getitem__(self, name: str) -> Transform:
        base, scan_ns, own_ns = self._base, self._scan_ns, self._own_ns
        carried = base.world and base.tree is not None and scan_ns != own_ns
        if name in self._joined and not carried:
            return self._joined[name]
        if base.tree is None:
            raise KeyError(name)
        if name in self._joined:
            top = base.world
            base_t_frame = base.velo_T_frame.inverse() @ self._joined[name]
            top_t_frame = _transform(base.tree, top, base.frame, own_ns) @ base_t_frame
        else:
            stands = is_fixed(name)
            top = base.world if carried and not stands else base.tree.common(base.frame, name)
            top_t_frame = _transform(base.tree, top, name, scan_ns if stands else own_ns)
        return base.velo_T_frame @ _transform(base.tree, base.frame, top, scan_ns) @ top_t_frame

    def __iter__(self) -> Iterator[str]:
        return iter(self._joined)

    def __len__(self) -> int:
        return len(self._joined)


def _transform(tree: MovingTree, target: str, source: str, stamp_ns: int) -> Transform:
    """Return target_T_source at a stamp.

    Raises:
        UnknownTransformError: It is not known then.
    """
    (transform,) = tree.transforms(target, source, np.array([stamp_ns], dtype=np.int64))
    if transform is None:
        raise UnknownTransformError(tree.reason(target, source, stamp_ns), stamp_ns)
    return transform


def stamp_of_boxes(message: Any) -> int:  # noqa: ANN401 - of the bag's types
    """Return the stamp of a message with boxes: a MarkerArray's is that of its markers, if any."""
    if hasattr(message, 'header'):
        return stamp_ns_of(message.header)
    stamps = (stamp_ns_of(marker.header) for marker in getattr(message, 'markers', ()))
    return next(filter(None, stamps), 0)
