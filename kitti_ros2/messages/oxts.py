# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OxtsPacket <-> sensor_msgs/Imu, sensor_msgs/NavSatFix, geometry_msgs/TwistStamped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__Twist as Twist,
)
from rosbags.typesys.stores.ros2_jazzy import (
    geometry_msgs__msg__TwistStamped as TwistStamped,
)
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__Imu as Imu,
)
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__NavSatFix as NavSatFix,
)
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__NavSatStatus as NavSatStatus,
)

from ..geometry import (
    quaternion_to_rotation,
    rotation_from_rpy,
    rotation_to_quaternion,
    rotation_to_rpy,
)
from .header import make_header, make_quaternion, make_vector3, vector_of

if TYPE_CHECKING:
    from ..geometry import Float64Array
    from ..samples import OxtsPacket

_UNKNOWN = np.zeros(9)
"""All zeros: covariance unknown (Imu.msg)."""

# OXTS position modes (devkit gps_mode_to_string): below 3 no position; 4 to 6 differential and RTK,
# a ground station; 7 to 9 WAAS, Omnistar, Omnistar HP, a satellite; above, of no known kind.
_STATUS_BY_MODE = dict.fromkeys(range(3), NavSatStatus.STATUS_NO_FIX)
_STATUS_BY_MODE |= dict.fromkeys(range(4, 7), NavSatStatus.STATUS_GBAS_FIX)
_STATUS_BY_MODE |= dict.fromkeys(range(7, 10), NavSatStatus.STATUS_SBAS_FIX)


def encode_imu(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> Imu:
    """Orientation of the body in east-north-up, rates and accelerations in body axes.

    Accelerations contain gravity (REP-145: an imu at rest, level, reads +g upwards); wx wy wz and
    ax ay az are taken, never the levelled columns.
    """
    rotation = rotation_from_rpy(packet.roll, packet.pitch, packet.yaw)
    return Imu(
        header=make_header(stamp_ns, frame_id),
        orientation=make_quaternion(rotation_to_quaternion(rotation)),
        orientation_covariance=_UNKNOWN,
        angular_velocity=make_vector3((packet.wx, packet.wy, packet.wz)),
        angular_velocity_covariance=_UNKNOWN,
        linear_acceleration=make_vector3((packet.ax, packet.ay, packet.az)),
        linear_acceleration_covariance=_UNKNOWN,
    )


def decode_imu(message: Imu) -> dict[str, float]:
    """The packet columns an Imu holds: roll pitch yaw, wx wy wz, ax ay az."""
    q = message.orientation
    rpy = rotation_to_rpy(quaternion_to_rotation(np.array([q.x, q.y, q.z, q.w])))
    values = (*rpy, *vector_of(message.angular_velocity), *vector_of(message.linear_acceleration))
    names = ('roll', 'pitch', 'yaw', 'wx', 'wy', 'wz', 'ax', 'ay', 'az')
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def encode_fix(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> NavSatFix:
    """Latitude, longitude, altitude; pos_accuracy is a sigma, so its square is the variance."""
    return NavSatFix(
        header=make_header(stamp_ns, frame_id),
        status=_status(packet),
        latitude=packet.lat,
        longitude=packet.lon,
        altitude=packet.alt,
        position_covariance=np.diag([packet.pos_accuracy**2] * 3).ravel(),
        position_covariance_type=NavSatFix.COVARIANCE_TYPE_APPROXIMATED,
    )


def _status(packet: OxtsPacket) -> Any:  # noqa: ANN401 - rosbags types the field by an older class
    status = _STATUS_BY_MODE.get(packet.posmode, NavSatStatus.STATUS_FIX)
    return NavSatStatus(status, NavSatStatus.SERVICE_GPS)


def decode_fix(message: NavSatFix) -> dict[str, float]:
    """The packet columns a NavSatFix holds: lat lon alt, pos_accuracy."""
    return {
        'lat': message.latitude,
        'lon': message.longitude,
        'alt': message.altitude,
        'pos_accuracy': float(np.sqrt(message.position_covariance[0])),
    }


def encode_velocity(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> TwistStamped:
    """Velocity and rates in body axes; vf vl vu are levelled, so roll and pitch are undone."""
    return TwistStamped(
        header=make_header(stamp_ns, frame_id),
        twist=Twist(
            linear=make_vector3(body_velocity(packet)),
            angular=make_vector3((packet.wx, packet.wy, packet.wz)),
        ),
    )


def decode_velocity(message: TwistStamped, roll: float, pitch: float) -> dict[str, float]:
    """The packet columns a TwistStamped holds, given roll and pitch: vf vl vu, wx wy wz."""
    levelled = rotation_from_rpy(roll, pitch, 0.0) @ vector_of(message.twist.linear)
    values = (*levelled, *vector_of(message.twist.angular))
    names = ('vf', 'vl', 'vu', 'wx', 'wy', 'wz')
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def body_velocity(packet: OxtsPacket) -> Float64Array:
    """(3,) m/s in imu_link axes."""
    velocity: Float64Array = rotation_from_rpy(packet.roll, packet.pitch, 0.0).T @ np.array(
        [packet.vf, packet.vl, packet.vu]
    )
    return velocity
