# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OxtsPacket <-> sensor_msgs/Imu, sensor_msgs/NavSatFix, geometry_msgs/TwistStamped.

A packet of any Imu, NavSatFix and TwistStamped of one moment:

======================  ============================================================================
columns                 from
======================  ============================================================================
lat lon                 NavSatFix, moved from its antenna to the unit; 0 without one
alt                     the same; 0 where that is NaN (a fix in two dimensions), and without one
roll pitch yaw          Imu (east-north-up, REP-103); 0 where it has no orientation
vn ve                   TwistStamped turned by the attitude, or as it is; 0 without one, unless
                        the places say how fast they move
vf vl vu                the same, levelled; vl positive to the right, as the files have it
ax ay az, af al au      Imu, gravity included; levelled, al positive to the left; 0 without one
wx wy wz, wf wl wu      Imu, else TwistStamped; levelled, wl about the left; 0 without either
pos_accuracy            square root of NavSatFix's variance; 0 where that is unknown
vel_accuracy            0: a TwistStamped has none
navstat numsats         0
posmode                 of the NavSatFix's status: 3 (SPS), 4 (differential) or 7 (WAAS); -1 without
velmode orimode         -1, as KITTI itself writes them where they are not known
======================  ============================================================================

A number that a message declares unknown (first element of its covariance -1), that is not finite or
that is 1e9 or more is treated as missing. All 30 columns are numbers and the last five whole ones,
whatever is missing.

Levelling is a turn by Ry(pitch) Rx(roll) into axes that lie on the earth's surface. Of KITTI's own
packets (2011_09_26, 108 of drive 0001; 154 of drive 0005) this gives af al au to 0.025 and 0.06
m/s^2, wf wl wu to 7e-5 and 8e-4 rad/s; any other sign of roll, pitch, al or wl is far worse. vf
is ve cos(yaw) + vn sin(yaw) to 0.0005 and 0.003 m/s, and vl is ve sin(yaw) - vn cos(yaw), positive
to the right, to 0.03 and 0.08 m/s.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.geographic import GeoOrigin
from ..model.geometry import (
    Transform,
    quaternion_to_rotation,
    rotation_from_rpy,
    rotation_to_quaternion,
    rotation_to_rpy,
)
from ..model.samples import OxtsPacket
from .header import make_header, make_quaternion, make_vector3, vector_of
from .oxts_covariance import (
    ACCELERATION_SIGMA,
    ANGULAR_VELOCITY_SIGMA,
    ORIENTATION_SIGMA,
    diagonal,
)
from .ros_types import Imu, NavSatFix, NavSatStatus, Twist, TwistStamped

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Float64Array
    from .ros_types import Vector3

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
_NO_STATES: list[int] = [0, 0, -1, -1, -1]
_NO_PACKET = OxtsPacket(*[0.0] * 25, *_NO_STATES)  # type: ignore[arg-type]
_IDENTITY = Transform.identity()
_NOT_KNOWN = -1.0
# Beyond, kitti/oxts_file.py refuses a packet.
_IMPOSSIBLE = 1e9  # m/s, m/s^2 or rad/s
_LEAST_MOTION = 1e-6  # m/s: sums of float32 in programs that have no velocity
_MAX_LAT_DEG, _MAX_LON_DEG, _MAX_ALT_M = 89.9, 360.0, 1e5


class Mounting(NamedTuple):
    """How the sensors of a packet are mounted on the unit; lever arms are compensated.

    Attributes:
        imu_t_frame: The Imu message's frame in KITTI's imu frame (x forward, y left, z up): its
            orientation, rates and accelerations are transformed to it.
        imu_t_velocity: The same of the TwistStamped.
        imu_t_antenna: The same of the NavSatFix, used where the attitude is known.
        velocity_is_enu: Whether the velocity is along east, north, up instead of the axes of its
            frame, as receivers with one antenna tell it; its rates are not used then.
    """

    imu_t_frame: Transform = _IDENTITY
    imu_t_velocity: Transform = _IDENTITY
    imu_t_antenna: Transform = _IDENTITY
    velocity_is_enu: bool = False


_ON_THE_UNIT = Mounting()


class UnitPose(NamedTuple):
    """The pose of the GPS/IMU unit.

    Attributes:
        attitude: (3, 3) KITTI's imu frame in east-north-up.
        lat, lon: Degrees.
        alt: Metres.
    """

    attitude: Float64Array
    lat: float
    lon: float
    alt: float


def encode_imu(
    packet: OxtsPacket, stamp_ns: int, frame_id: str, *, covariances: bool = False
) -> Imu:
    """Make an Imu: orientation of the body in east-north-up, rates and accelerations in body axes.

    Accelerations contain gravity (REP-145: an imu at rest, level, reads +g upwards); wx wy wz and
    ax ay az are taken, never the levelled columns. Without covariances these are unknown (zeros).
    """
    sigmas = (ORIENTATION_SIGMA, ANGULAR_VELOCITY_SIGMA, ACCELERATION_SIGMA)
    known = [diagonal(sigma) if covariances else _UNKNOWN for sigma in sigmas]
    rotation = rotation_from_rpy(packet.roll, packet.pitch, packet.yaw)
    return Imu(
        header=make_header(stamp_ns, frame_id),
        orientation=make_quaternion(rotation_to_quaternion(rotation)),
        orientation_covariance=known[0],
        angular_velocity=make_vector3((packet.wx, packet.wy, packet.wz)),
        angular_velocity_covariance=known[1],
        linear_acceleration=make_vector3((packet.ax, packet.ay, packet.az)),
        linear_acceleration_covariance=known[2],
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


def encode_velocity(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> TwistStamped:
    """Make a TwistStamped: velocity and rates in body axes, from ve vn vu (see body_velocity)."""
    return TwistStamped(
        header=make_header(stamp_ns, frame_id),
        twist=Twist(
            linear=make_vector3(packet.body_velocity()),
            angular=make_vector3((packet.wx, packet.wy, packet.wz)),
        ),
    )


def make_packet(
    imu: Imu | None,
    fix: NavSatFix | None,
    velocity: TwistStamped | None,
    *,
    mounting: Mounting = _ON_THE_UNIT,
    pose: UnitPose | None = None,
    moving: Float64Array | None = None,
) -> OxtsPacket | None:
    """Make the packet of messages of one moment; None where the NavSatFix has no fix.

    Args:
        imu: None where the recording has no such stream, as are the others.
        fix: The place of its frame, which is the antenna's (NavSatFix.msg).
        velocity: Along the axes of its frame, as encode_velocity writes it.
        mounting: Of the sensors.
        pose: Place and attitude from another source, which replace those of the messages; rates
            are then those of the velocity, if it has any.
        moving: (3,) m/s east, north, up that the place moves at, of the pose or of the fix; it
            replaces the velocity of the message.
    """
    if fix is not None and not has_fix(fix):
        return None
    imu_t_frame, imu_t_velocity, imu_t_antenna, velocity_is_enu = mounting
    attitude = _attitude(imu, imu_t_frame) if pose is None else pose.attitude
    roll, pitch, yaw = rotation_to_rpy(attitude)
    columns = {'roll': roll, 'pitch': pitch, 'yaw': yaw}
    level = rotation_from_rpy(roll, pitch, 0.0)
    turns = None if velocity_is_enu else velocity
    turning = turns is not None and bool(vector_of(turns.twist.angular).any())
    sensing = None if pose is not None and turning else imu
    rates = _rates(sensing, turns, imu_t_frame, imu_t_velocity)
    columns |= _named(('wx', 'wy', 'wz'), rates) | _named(('wf', 'wl', 'wu'), level @ rates)
    if imu is not None:
        sensed = _known(imu.linear_acceleration, imu.linear_acceleration_covariance)
        acceleration = imu_t_frame.rotation @ (np.zeros(3) if sensed is None else sensed)
        columns |= _named(('ax', 'ay', 'az'), acceleration)
        columns |= _named(('af', 'al', 'au'), level @ acceleration)
    lever = imu_t_velocity.translation
    linear = None if velocity is None else _known(velocity.twist.linear)
    oriented = imu is not None and has_orientation(imu)
    if moving is not None:
        at_unit = pose is not None or not oriented or not moving.any()
        lever = np.zeros(3) if at_unit else imu_t_antenna.translation
    elif linear is not None:
        moving = linear if velocity_is_enu else attitude @ imu_t_velocity.rotation @ linear
    if moving is not None:
        columns |= _velocity_columns(moving - attitude @ np.cross(rates, lever), yaw)
    if fix is not None:
        columns |= _fix_columns(fix)
        if oriented:
            columns |= _moved(fix, columns, attitude @ -imu_t_antenna.translation)
    if pose is not None:
        columns |= {'lat': pose.lat, 'lon': pose.lon, 'alt': pose.alt}
    unsigned_zeros = {name: value + 0.0 for name, value in columns.items()}
    posmode = _NO_MODE if fix is None else _LEAST_MODE_BY_STATUS.get(fix.status.status, _NO_MODE)
    return replace(_NO_PACKET, posmode=posmode, **unsigned_zeros)  # type: ignore[arg-type] # floats


def has_orientation(imu: Imu) -> bool:
    """Whether an Imu has an orientation; without it a packet's attitude is 0.

    Imu.msg: -1 as the first element of the covariance declares it unknown. Some drivers leave the
    quaternion all zeros instead.
    """
    q = imu.orientation
    rotation = quaternion_to_rotation((q.x, q.y, q.z, q.w))
    return bool(imu.orientation_covariance[0] != _NOT_KNOWN and np.isfinite(rotation).all())


def has_fix(fix: NavSatFix) -> bool:
    """Whether a NavSatFix has a position (status below 0 is no fix) within KITTI's limits.

    Many receivers say 0, 0 with any status until they have a fix.
    """
    # Comparisons with NaN are false: a NaN latitude is refused, a NaN altitude accepted.
    on_earth = abs(fix.latitude) <= _MAX_LAT_DEG and abs(fix.longitude) <= _MAX_LON_DEG
    placed = fix.status.status >= 0 and on_earth and (fix.latitude or fix.longitude)
    return bool(placed and not abs(fix.altitude) > _MAX_ALT_M)


def place_of(fix: NavSatFix | None) -> tuple[float, float, float]:
    """Return latitude, longitude and altitude of a NavSatFix; NaN without a fix."""
    if fix is None or not has_fix(fix):
        return np.nan, np.nan, np.nan
    return float(fix.latitude), float(fix.longitude), float(fix.altitude)


def has_motion(message: Any) -> bool:  # noqa: ANN401 - a TwistStamped or Odometry of the bag
    """Whether a message with a twist has a velocity that is not 0."""
    twist = getattr(message.twist, 'twist', message.twist)
    linear = _known(twist.linear)
    return linear is not None and bool((np.abs(linear) > _LEAST_MOTION).any())


def _attitude(imu: Imu | None, imu_t_frame: Transform) -> Float64Array:
    """Return the (3, 3) rotation of KITTI's imu frame in east-north-up."""
    if imu is None or not has_orientation(imu):
        return np.eye(3)
    q = imu.orientation
    rotation: Float64Array = quaternion_to_rotation((q.x, q.y, q.z, q.w)) @ imu_t_frame.rotation.T
    return rotation


def _rates(
    imu: Imu | None,
    velocity: TwistStamped | None,
    imu_t_frame: Transform,
    imu_t_velocity: Transform,
) -> Float64Array:
    """Return (3,) rad/s about the axes of KITTI's imu frame."""
    if imu is not None:
        sensed = _known(imu.angular_velocity, imu.angular_velocity_covariance)
        if sensed is not None:
            return np.asarray(imu_t_frame.rotation @ sensed)
    turning = None if velocity is None else _known(velocity.twist.angular)
    return np.zeros(3) if turning is None else np.asarray(imu_t_velocity.rotation @ turning)


def _velocity_columns(east_north_up: Float64Array, yaw: float) -> dict[str, float]:
    ve, vn, vu = (float(value) for value in east_north_up)
    sine, cosine = float(np.sin(yaw)), float(np.cos(yaw))
    return {
        've': ve,
        'vn': vn,
        'vu': vu,
        'vf': ve * cosine + vn * sine,
        'vl': ve * sine - vn * cosine,
    }


def _fix_columns(fix: NavSatFix) -> dict[str, float]:
    known = fix.position_covariance_type != NavSatFix.COVARIANCE_TYPE_UNKNOWN
    with np.errstate(invalid='ignore'):
        accuracy = float(np.sqrt(fix.position_covariance[0])) if known else 0.0
    columns = {
        'lat': fix.latitude,
        'lon': fix.longitude,
        'alt': fix.altitude,
        'pos_accuracy': accuracy,
    }
    return {name: value if np.isfinite(value) else 0.0 for name, value in columns.items()}


def _moved(
    fix: NavSatFix, columns: Mapping[str, float], east_north_up: Float64Array
) -> dict[str, float]:
    east, north, up = east_north_up.tolist()
    place = GeoOrigin(columns['lat'], columns['lon'], columns['alt'])
    return asdict(place.moved(east, north, up if np.isfinite(fix.altitude) else 0.0))


def _known(vector: Vector3, covariance: Float64Array | None = None) -> Float64Array | None:
    """Return (3,) of a vector; None where it is declared unknown or not finite."""
    values = vector_of(vector)
    declared_unknown = covariance is not None and covariance[0] == _NOT_KNOWN
    return None if declared_unknown or not (np.abs(values) < _IMPOSSIBLE).all() else values


def _named(names: tuple[str, str, str], values: Float64Array) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))
