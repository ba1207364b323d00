# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pose <-> nav_msgs/Odometry and tf2_msgs/TFMessage; Trajectory -> nav_msgs/Path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.samples import Pose, Trajectory
from .header import make_header, make_pose, make_vector3, transform_of, vector_of
from .ros_types import (
    Odometry,
    Path,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Twist,
    TwistWithCovariance,
)
from .transforms import make_transform

if TYPE_CHECKING:
    from ..model.geometry import Float64Array, Transform


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


def _covariance(sigma: float | None) -> Float64Array:
    """Return (36,) with the variance of x, y and z; zeros are unknown."""
    variance = 0.0 if sigma is None else sigma**2
    return np.diag([variance] * 3 + [0.0] * 3).ravel()


def _sigma(covariance: Float64Array) -> float | None:
    return float(np.sqrt(covariance[0])) if covariance[0] > 0 else None
