# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OxtsPacket -> sensor_msgs/Imu, sensor_msgs/NavSatFix, geometry_msgs/TwistStamped.

The inverse is importer.oxts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..model.geometry import rotation_from_rpy, rotation_to_quaternion
from .header import make_header, make_quaternion, make_vector3
from .ros_types import Imu, NavSatFix, NavSatStatus, Twist, TwistStamped

if TYPE_CHECKING:
    from ..model.samples import OxtsPacket

_UNKNOWN = np.zeros(9)
"""All zeros: covariance unknown (Imu.msg)."""

# Position modes with a fix, of all that OXTS documents (devkit gps_mode_to_string; "Position modes
# quoted by OxTS units"). Unaided: SPS, also post-processed, gx and ix, and PPP; a ground station:
# differential and RTK, the same variants; a satellite: WAAS, OmniSTAR, OmniSTAR XP and CDGPS. Any
# other is no fix: none, search, doppler, no data, blanked, and -1, KITTI's for unknown.
_STATUS_BY_MODE = dict.fromkeys((3, 13, 21, 26, 30, 31), NavSatStatus.STATUS_FIX)
_STATUS_BY_MODE |= dict.fromkeys(
    (4, 5, 6, 14, 15, 16, 22, 23, 24, 27, 28, 29), NavSatStatus.STATUS_GBAS_FIX
)
_STATUS_BY_MODE |= dict.fromkeys((7, 8, 9, 17, 18), NavSatStatus.STATUS_SBAS_FIX)
_LEAST_MODE_BY_STATUS = {
    NavSatStatus.STATUS_FIX: 3,
    NavSatStatus.STATUS_GBAS_FIX: 4,
    NavSatStatus.STATUS_SBAS_FIX: 7,
}
_NO_MODE = -1


def encode_imu(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> Imu:
    """Make an Imu: orientation of the body in east-north-up, rates and accelerations in body axes.

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


def encode_fix(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> NavSatFix:
    """Make a NavSatFix of the packet's numbers: KITTI's altitude is above sea level.

    NavSatFix.msg asks for the height above the ellipsoid, some 48 m more in Karlsruhe: KITTI has no
    geoid to convert with (the unit's default: OXTS, "Altitude reference options"). pos_accuracy is
    the sigma of north and east, so its square is the variance, for up an approximation; 0 is
    unknown. A packet without a fix keeps its position, which the unit carries on from its inertial
    sensors.
    """
    known = packet.pos_accuracy > 0
    return NavSatFix(
        header=make_header(stamp_ns, frame_id),
        status=_status(packet),
        latitude=packet.lat,
        longitude=packet.lon,
        altitude=packet.alt,
        position_covariance=np.diag([packet.pos_accuracy**2] * 3).ravel(),
        position_covariance_type=(
            NavSatFix.COVARIANCE_TYPE_APPROXIMATED if known else NavSatFix.COVARIANCE_TYPE_UNKNOWN
        ),
    )


def _status(packet: OxtsPacket) -> Any:  # noqa: ANN401 - rosbags types the field by an older class
    status = _STATUS_BY_MODE.get(packet.posmode, NavSatStatus.STATUS_NO_FIX)
    return NavSatStatus(status, NavSatStatus.SERVICE_GPS)


def decode_fix(message: NavSatFix) -> dict[str, float]:
    """Return the packet columns in a NavSatFix: lat lon alt, pos_accuracy."""
    return {
        'lat': message.latitude,
        'lon': message.longitude,
        'alt': message.altitude,
        'pos_accuracy': float(np.sqrt(message.position_covariance[0])),
    }


def position_mode(message: NavSatFix) -> int:
    """Return the least accurate posmode of the fix's status; -1 without a fix."""
    return _LEAST_MODE_BY_STATUS.get(message.status.status, _NO_MODE)


def encode_velocity(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> TwistStamped:
    """Make a TwistStamped: velocity and rates in body axes, from ve vn vu (see body_velocity)."""
    return TwistStamped(
        header=make_header(stamp_ns, frame_id),
        twist=Twist(
            linear=make_vector3(packet.body_velocity()),
            angular=make_vector3((packet.wx, packet.wy, packet.wz)),
        ),
    )
