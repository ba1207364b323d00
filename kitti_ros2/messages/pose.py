# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pose <-> nav_msgs/Odometry; Pose -> tf2_msgs/TFMessage; Trajectory -> nav_msgs/Path.

The poses of any Odometry, PoseStamped, Path or TFMessage are read with their stamps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.samples import Pose, Trajectory
from .header import make_header, make_pose, make_vector3, stamp_ns_of, transform_of, vector_of
from .ros_types import (
    Odometry,
    Path,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Twist,
    TwistWithCovariance,
)
from .transforms import decode_static, make_transform

if TYPE_CHECKING:
    from ..model.geometry import Float64Array, Transform

_FARTHEST_M = 1e9


def encode_odometry(
    pose: Pose, base_t_imu: Transform, stamp_ns: int, frames: tuple[str, str]
) -> Odometry:
    """Make an Odometry: the pose of base_link in map, and its motion in base_link.

    Args:
        pose: Of imu_link in map.
        base_t_imu: imu_link in base_link; the lever arm is compensated.
        stamp_ns: Nanoseconds.
        frames: Names of map and base_link.
    """
    map_t_base = pose.world_T_imu @ base_t_imu.inverse()
    linear, angular = np.zeros(3), np.zeros(3)
    if pose.velocity is not None and pose.angular_velocity is not None:
        angular = base_t_imu.rotation @ pose.angular_velocity
        linear = base_t_imu.rotation @ pose.velocity - np.cross(angular, base_t_imu.translation)
    return Odometry(
        header=make_header(stamp_ns, frames[0]),
        child_frame_id=frames[1],
        pose=PoseWithCovariance(make_pose(map_t_base), _covariance(pose.position_sigma)),
        twist=TwistWithCovariance(
            Twist(make_vector3(linear), make_vector3(angular)), _covariance(pose.velocity_sigma)
        ),
    )


def decode_odometry(message: Odometry, base_t_imu: Transform) -> Pose:
    """Decode a pose: the inverse of encode_odometry; a motion of zeros is unknown."""
    linear = vector_of(message.twist.twist.linear)
    angular = vector_of(message.twist.twist.angular)
    moving = bool(linear.any() or angular.any())
    back = base_t_imu.rotation.T
    velocity = back @ (linear + np.cross(angular, base_t_imu.translation))
    return Pose(
        transform_of(message.pose.pose) @ base_t_imu,
        velocity=velocity if moving else None,
        angular_velocity=back @ angular if moving else None,
        position_sigma=_sigma(message.pose.covariance),
        velocity_sigma=_sigma(message.twist.covariance),
    )


def encode_tf(
    pose: Pose, base_t_imu: Transform, stamp_ns: int, frames: tuple[str, str]
) -> TFMessage:
    """Make the dynamic transform map -> base_link."""
    map_t_base = pose.world_T_imu @ base_t_imu.inverse()
    return TFMessage([make_transform(map_t_base, stamp_ns, frames[0], frames[1])])


def encode_path(
    trajectory: Trajectory, base_t_imu: Transform, stamp_ns: int, frame_id: str
) -> Path:
    """Make a Path of all poses of base_link in map, each with its own stamp."""
    imu_t_base = base_t_imu.inverse()
    poses = [
        PoseStamped(make_header(stamp, frame_id), make_pose(map_t_imu @ imu_t_base))
        for stamp, map_t_imu in zip(
            trajectory.stamps_ns.tolist(), trajectory.world_T_imu, strict=True
        )
    ]
    return Path(make_header(stamp_ns, frame_id), poses)


def poses_of(message: Odometry | PoseStamped | Path) -> list[tuple[int, Transform]]:
    """Decode the poses of any Odometry, PoseStamped or Path: stamp (nanoseconds) and pose of each.

    Raises:
        ValueError: One of them is invalid: NaN, or an orientation of all zeros.
    """
    return [
        (stamp_ns_of(each.header), _checked(transform_of(getattr(each.pose, 'pose', each.pose))))
        for each in getattr(message, 'poses', [message])
    ]


def poses_of_link(message: TFMessage, link: tuple[str, str]) -> list[tuple[int, Transform]]:
    """Decode the transforms of a link (parent, child) in a TFMessage: stamp and parent_T_child.

    Raises:
        ValueError: One of them is invalid.
    """
    # ROS 1 begins names with a slash, which tf2 does not allow.
    wanted = [
        each
        for each in message.transforms
        if (each.header.frame_id.lstrip('/'), each.child_frame_id.lstrip('/')) == link
    ]
    decoded = decode_static(TFMessage(wanted))
    return [
        (stamp_ns_of(each.header), _checked(transform))
        for each, (*_, transform) in zip(wanted, decoded, strict=True)
    ]


def _checked(transform: Transform) -> Transform:
    if not (np.abs(transform.matrix()) <= _FARTHEST_M).all():
        raise ValueError('a pose of NaN, of an impossible place or of an orientation of all zeros')
    return transform


def _covariance(sigma: float | None) -> Float64Array:
    """Return (36,) with the variance of x, y and z; zeros are unknown."""
    variance = 0.0 if sigma is None else sigma * sigma
    return np.diag([variance] * 3 + [0.0] * 3).ravel()


def _sigma(covariance: Float64Array) -> float | None:
    return float(np.sqrt(covariance[0])) if covariance[0] > 0 else None
