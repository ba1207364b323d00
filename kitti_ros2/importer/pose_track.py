# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle was at each frame: messages -> a track of poses -> KITTI's camera poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..messages.header import stamp_ns_of, transform_of
from ..messages.ros_types import TFMessage
from ..messages.transforms import decode_static
from ..model.geometry import Transform
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    import numpy.typing as npt

    from ..messages.header import Header, Pose
    from ..messages.ros_types import Odometry, Path, PoseStamped
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

MAX_GAP_NS = NS_PER_S + NS_PER_S // 2
"""Poses once a second, unevenly, still make a track. Further apart they say little of what was
between: in a bend of 0.2 rad/s at 10 m/s the straight line of these 1.5 s is 0.6 m off."""


_FARTHEST_M = 1e9


@dataclass(frozen=True, eq=False)
class StampedPose:
    """A pose as a message tells it.

    Attributes:
        parent: The frame it is given in.
        child: The frame whose pose it is, None where the message does not tell.
        parent_T_child: The pose.
        stamp_ns: Nanoseconds.
    """

    parent: str
    child: str | None
    parent_T_child: Transform
    stamp_ns: int


class PoseTrack:
    """Poses of one frame in another over time, and what lies between them.

    Between two poses the translation is linear and the rotation turns evenly about one axis the
    short way round (slerp). Nothing is extrapolated.
    """

    def __init__(
        self,
        stamps_ns: npt.ArrayLike,
        transforms: Sequence[Transform],
        max_gap_ns: int = MAX_GAP_NS,
    ) -> None:
        """Take poses in any order; of several with one stamp the first counts.

        Args:
            stamps_ns: (N,) nanoseconds.
            transforms: N of them.
            max_gap_ns: Two poses further apart have nothing known between them.

        Raises:
            ValueError: Not as many stamps as transforms.
        """
        stamps = np.asarray(stamps_ns, dtype=np.int64)
        if stamps.shape != (len(transforms),):
            raise ValueError(f'{len(transforms)} poses with stamps of shape {stamps.shape}')
        self.stamps_ns, first = np.unique(stamps, return_index=True)
        self._transforms = [transforms[index] for index in first]
        self._max_gap_ns = max_gap_ns

    def __len__(self) -> int:
        return len(self._transforms)

    def at(self, stamps_ns: Int64Array) -> list[Transform | None]:
        """The pose at each of (M,) stamps; None before, after, and in too large a gap."""
        if not self._transforms:
            return [None] * len(stamps_ns)
        wanted = np.asarray(stamps_ns, dtype=np.int64)
        after = np.searchsorted(self.stamps_ns, wanted)
        known = after < len(self)
        after[~known] = 0
        exact = known & (self.stamps_ns[after] == wanted)
        before = np.maximum(after - 1, 0)
        gaps = self.stamps_ns[after] - self.stamps_ns[before]
        between = known & (after > 0) & (gaps <= self._max_gap_ns) & ~exact
        share = (wanted - self.stamps_ns[before]) / np.maximum(gaps, 1)
        poses: list[Transform | None] = [None] * len(wanted)
        for index in np.flatnonzero(exact).tolist():
            poses[index] = self._transforms[after[index]]
        for index in np.flatnonzero(between).tolist():
            pair = self._transforms[before[index]], self._transforms[after[index]]
            poses[index] = interpolate(*pair, float(share[index]))
        return poses


def interpolate(start: Transform, end: Transform, share: float) -> Transform:
    """The pose a share (0..1) of the way from start to end: linear, and slerp."""
    q_start, q_end = start.quaternion(), end.quaternion()
    if q_start @ q_end < 0:
        q_end = -q_end
    # Not the arc cosine of the product: it knows small angles to 1e-8 only.
    angle = 2 * np.arctan2(np.linalg.norm(q_end - q_start), np.linalg.norm(q_end + q_start))
    quaternion = _sine_share(1 - share, angle) * q_start + _sine_share(share, angle) * q_end
    step = end.translation - start.translation
    return Transform.from_quaternion(quaternion, start.translation + share * step)


def _sine_share(share: float, angle: float) -> float:
    """sin(share * angle) / sin(angle), also for an angle of 0."""
    return float(share * np.sinc(share * angle / np.pi) / np.sinc(angle / np.pi))


def camera_poses(
    track: PoseTrack, frames_ns: Int64Array, body_t_cam0: Transform
) -> list[Float64Array | None]:
    """The poses of a data set's frames as KITTI odometry has them.

    Args:
        track: Poses of the body in a fixed frame.
        frames_ns: (N,) stamps, nanoseconds.
        body_t_cam0: Where the rectified camera 0 is on the body.

    Returns:
        For each frame (3, 4) float64: the rectified camera 0 in that of the first frame that has a
        pose, metres; None where there is no pose.
    """
    poses = track.at(frames_ns)
    start = next((pose for pose in poses if pose is not None), None)
    if start is None:
        return [None] * len(poses)
    # Maps may be far from their origin (UTM); the difference first keeps all the digits there are.
    near = Transform.from_translation(-start.translation)
    first_cam0_t_near = (near @ start @ body_t_cam0).inverse()
    return [
        None if pose is None else (first_cam0_t_near @ (near @ pose @ body_t_cam0)).matrix()[:3]
        for pose in poses
    ]


def poses_from_odometry(message: Odometry) -> list[StampedPose]:
    """The one pose of a nav_msgs/Odometry.

    Raises:
        ValueError: It is no pose: NaN, or an orientation of all zeros.
    """
    child = _frame(message.child_frame_id) or None
    return [_stamped(message.header, child, message.pose.pose)]


def poses_from_pose_stamped(message: PoseStamped) -> list[StampedPose]:
    """The one pose of a geometry_msgs/PoseStamped, which does not say of what frame.

    Raises:
        ValueError: It is no pose.
    """
    return [_stamped(message.header, None, message.pose)]


def poses_from_path(message: Path) -> list[StampedPose]:
    """The poses of a nav_msgs/Path, each with its own stamp.

    Raises:
        ValueError: One of them is no pose.
    """
    return [
        _stamped(stamped.header, None, stamped.pose, message.header.frame_id)
        for stamped in message.poses
    ]


def poses_from_tf(message: TFMessage, links: Collection[tuple[str, str]]) -> list[StampedPose]:
    """The poses of some links (parent, child) that a tf2_msgs/TFMessage holds.

    Raises:
        ValueError: One of them is no pose.
    """
    wanted = [
        stamped
        for stamped in message.transforms
        if (_frame(stamped.header.frame_id), _frame(stamped.child_frame_id)) in links
    ]
    decoded = decode_static(TFMessage(wanted))
    return [
        StampedPose(_frame(parent), _frame(child), _checked(transform), stamp_ns_of(stamped.header))
        for stamped, (parent, child, transform) in zip(wanted, decoded, strict=True)
    ]


def _stamped(
    header: Header, child: str | None, pose: Pose, default_parent: str = ''
) -> StampedPose:
    transform = _checked(transform_of(pose))
    parent = _frame(header.frame_id) or _frame(default_parent)
    return StampedPose(parent, child, transform, stamp_ns_of(header))


def _checked(transform: Transform) -> Transform:
    if not (np.abs(transform.matrix()) <= _FARTHEST_M).all():
        raise ValueError('a pose of NaN, of an impossible place or of an orientation of all zeros')
    return transform


def _frame(name: str) -> str:
    """A frame's name; ROS 1 may lead it with a slash, which is no part of it to tf2."""
    return name.lstrip('/')
