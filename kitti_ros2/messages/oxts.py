# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""OxtsPacket <-> sensor_msgs/Imu, sensor_msgs/NavSatFix, geometry_msgs/TwistStamped.

A packet of any Imu, NavSatFix and TwistStamped of one time:

======================  ============================================================================
columns                 from
======================  ============================================================================
lat lon                 NavSatFix, moved from its antenna to the IMU; 0 without one
alt                     the same; 0 where that is NaN (a fix in two dimensions), and without one
roll pitch yaw          Imu (east-north-up, REP-103); 0 where it has no orientation
vn ve                   TwistStamped turned by the attitude, or as it is; 0 without one, unless
                        the positions give the velocity
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

import struct
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.geometry import (
    Transform,
    quaternion_to_rotation,
    rotation_from_rpy,
    rotation_to_quaternion,
    rotation_to_rpy,
)
from ..model.samples import OxtsPacket, Pose, Trajectory
from ..model.streams import GeoOrigin, from_sec_nanosec
from .camera_info import decode_static, make_transform
from .cdr import (
    make_header,
    make_pose,
    make_quaternion,
    make_vector3,
    stamp_ns_of,
    transform_of,
    vector_of,
)
from .ros_types import (
    Imu,
    NavSatFix,
    NavSatStatus,
    Odometry,
    Path,
    PoseStamped,
    PoseWithCovariance,
    TFMessage,
    Twist,
    TwistStamped,
    TwistWithCovariance,
    TwistWithCovarianceStamped,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..model.geometry import Float64Array
    from .ros_types import Vector3


# Covariances of the GPS/IMU's messages: one standard deviation each, axes independent.
#
# =====================  =============  ============================================================
# part                   sigma          from
# =====================  =============  ============================================================
# position               pos_accuracy   the packet; 0 is declared unknown, as NavSatFix can
# velocity               vel_accuracy   the packet; 0.1 m/s for 0, unknown, which a twist cannot
#                                       declare: above the greatest of drives 0001 (0.013) and
#                                       0005 (0.078)
# orientation            0.1 degrees    A. Geiger et al., "Vision meets Robotics: The KITTI
#                                       Dataset", IJRR 2013, section 2: OXTS RT3003, 0.02 m / 0.1
#                                       degrees; as OXTS's RT user manual 190731, page 16, for the
#                                       heading of two antennas 2 m apart (0.2 degrees per metre)
# angular velocity       0.01 deg/s     gtsam c24a2c9, line 2 of examples/Data/
#                                       KittiEquivBiasedImu_metadata.txt, on KITTI's IMU: 0.000175
#                                       rad/s
# acceleration           0.01 m/s^2     the same file and line
# =====================  =============  ============================================================
#
# KITTI's packets have no accuracy of orientation, rates and accelerations. robot_localization takes
# a variance below 1e-9 for 1e-9 (src/ekf.cpp, Ekf::correct): with zeros its filter follows that
# sensor alone.

ORIENTATION_SIGMA = float(np.radians(0.1))
ANGULAR_VELOCITY_SIGMA = float(np.radians(0.01))
ACCELERATION_SIGMA = 0.01
UNKNOWN_VELOCITY_SIGMA = 0.1


def diagonal(*sigmas: float) -> Float64Array:
    """Return the covariance of axes in threes, row by row: (9,) of one sigma, (36,) of two."""
    variances = np.repeat(np.square(sigmas), 3)
    return np.diag(variances).ravel()


def encode_velocity_with_covariance(
    packet: OxtsPacket, stamp_ns: int, frame_id: str
) -> TwistWithCovarianceStamped:
    """Make a TwistWithCovarianceStamped: the TwistStamped of the packet with its covariance."""
    linear = packet.vel_accuracy if packet.vel_accuracy > 0 else UNKNOWN_VELOCITY_SIGMA
    twist = Twist(
        linear=make_vector3(packet.body_velocity()),
        angular=make_vector3((packet.wx, packet.wy, packet.wz)),
    )
    return TwistWithCovarianceStamped(
        header=make_header(stamp_ns, frame_id),
        twist=TwistWithCovariance(twist, diagonal(linear, ANGULAR_VELOCITY_SIGMA)),
    )


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
# Beyond, kitti/text_file.py refuses a packet.
_IMPOSSIBLE = 1e9  # m/s, m/s^2 or rad/s
_LEAST_MOTION = 1e-6  # m/s: sums of float32 in programs that have no velocity
_MAX_LAT_DEG, _MAX_LON_DEG, _MAX_ALT_M = 89.9, 360.0, 1e5


class Mounting(NamedTuple):
    """The mounting of a packet's sensors on the GPS/IMU; lever arms are compensated.

    Attributes:
        imu_t_frame: The Imu message's frame in KITTI's imu frame (x forward, y left, z up): its
            orientation, rates and accelerations are transformed to it.
        imu_t_velocity: The same of the TwistStamped.
        imu_t_antenna: The same of the NavSatFix, used where the attitude is known.
        velocity_is_enu: Whether the velocity is along east, north, up instead of the axes of its
            frame, as receivers with one antenna send it; its rates are not used then.
    """

    imu_t_frame: Transform = _IDENTITY
    imu_t_velocity: Transform = _IDENTITY
    imu_t_antenna: Transform = _IDENTITY
    velocity_is_enu: bool = False


_AT_THE_IMU = Mounting()


class ImuPose(NamedTuple):
    """The pose of the GPS/IMU.

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
    covariance = [diagonal(sigma) if covariances else _UNKNOWN for sigma in sigmas]
    rotation = rotation_from_rpy(packet.roll, packet.pitch, packet.yaw)
    return Imu(
        header=make_header(stamp_ns, frame_id),
        orientation=make_quaternion(rotation_to_quaternion(rotation)),
        orientation_covariance=covariance[0],
        angular_velocity=make_vector3((packet.wx, packet.wy, packet.wz)),
        angular_velocity_covariance=covariance[1],
        linear_acceleration=make_vector3((packet.ax, packet.ay, packet.az)),
        linear_acceleration_covariance=covariance[2],
    )


def encode_fix(packet: OxtsPacket, stamp_ns: int, frame_id: str) -> NavSatFix:
    """Make a NavSatFix of the packet's numbers: KITTI's altitude is above sea level.

    NavSatFix.msg asks for the height above the ellipsoid, some 48 m more in Karlsruhe: KITTI has no
    geoid to convert with (the IMU's default: OXTS, "Altitude reference options"). pos_accuracy is
    the sigma of north and east, so its square is the variance, for up an approximation; 0 is
    unknown. A packet without a fix keeps its position, which the IMU carries on from its inertial
    sensors.
    """
    valid = packet.pos_accuracy > 0
    return NavSatFix(
        header=make_header(stamp_ns, frame_id),
        status=_status(packet),
        latitude=packet.lat,
        longitude=packet.lon,
        altitude=packet.alt,
        position_covariance=np.diag([packet.pos_accuracy**2] * 3).ravel(),
        position_covariance_type=(
            NavSatFix.COVARIANCE_TYPE_APPROXIMATED if valid else NavSatFix.COVARIANCE_TYPE_UNKNOWN
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
    mounting: Mounting = _AT_THE_IMU,
    pose: ImuPose | None = None,
    moving: Float64Array | None = None,
) -> OxtsPacket | None:
    """Make the packet of messages of one time; None where the NavSatFix has no fix.

    Args:
        imu: None where the recording has no such stream, as are the others.
        fix: The position of its frame, which is the antenna's (NavSatFix.msg).
        velocity: Along the axes of its frame, as encode_velocity writes it.
        mounting: Mounting of the sensors.
        pose: Place and attitude from another source, which replace those of the messages; rates
            are then those of the velocity, if it has any.
        moving: (3,) m/s east, north, up that the position moves at, of the pose or of the fix; it
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
        sensed = _values_of(imu.linear_acceleration, imu.linear_acceleration_covariance)
        acceleration = imu_t_frame.rotation @ (np.zeros(3) if sensed is None else sensed)
        columns |= _named(('ax', 'ay', 'az'), acceleration)
        columns |= _named(('af', 'al', 'au'), level @ acceleration)
    lever = imu_t_velocity.translation
    linear = None if velocity is None else _values_of(velocity.twist.linear)
    oriented = imu is not None and has_orientation(imu)
    if moving is not None:
        at_imu = pose is not None or not oriented or not moving.any()
        lever = np.zeros(3) if at_imu else imu_t_antenna.translation
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
    """Return whether an Imu has an orientation; without it a packet's attitude is 0.

    Imu.msg: -1 as the first element of the covariance declares it unknown. Some drivers leave the
    quaternion all zeros instead.
    """
    q = imu.orientation
    rotation = quaternion_to_rotation((q.x, q.y, q.z, q.w))
    return bool(imu.orientation_covariance[0] != _NOT_KNOWN and np.isfinite(rotation).all())


def has_fix(fix: NavSatFix) -> bool:
    """Return whether a NavSatFix has a position (status below 0 is no fix) within KITTI's limits.

    Many receivers say 0, 0 with any status until they have a fix.
    """
    # Comparisons with NaN are false: a NaN latitude is refused, a NaN altitude accepted.
    on_earth = abs(fix.latitude) <= _MAX_LAT_DEG and abs(fix.longitude) <= _MAX_LON_DEG
    placed = fix.status.status >= 0 and on_earth and (fix.latitude or fix.longitude)
    return bool(placed and not abs(fix.altitude) > _MAX_ALT_M)


def position_of(fix: NavSatFix | None) -> tuple[float, float, float]:
    """Return latitude, longitude and altitude of a NavSatFix; NaN without a fix."""
    if fix is None or not has_fix(fix):
        return np.nan, np.nan, np.nan
    return float(fix.latitude), float(fix.longitude), float(fix.altitude)


def has_motion(message: Any) -> bool:  # noqa: ANN401 - a TwistStamped or Odometry of the bag
    """Return whether a message with a twist has a velocity that is not 0."""
    twist = getattr(message.twist, 'twist', message.twist)
    linear = _values_of(twist.linear)
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
        sensed = _values_of(imu.angular_velocity, imu.angular_velocity_covariance)
        if sensed is not None:
            return np.asarray(imu_t_frame.rotation @ sensed)
    turning = None if velocity is None else _values_of(velocity.twist.angular)
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
    has_covariance = fix.position_covariance_type != NavSatFix.COVARIANCE_TYPE_UNKNOWN
    with np.errstate(invalid='ignore'):
        accuracy = float(np.sqrt(fix.position_covariance[0])) if has_covariance else 0.0
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
    origin = GeoOrigin(columns['lat'], columns['lon'], columns['alt'])
    return asdict(origin.moved(east, north, up if np.isfinite(fix.altitude) else 0.0))


def _values_of(vector: Vector3, covariance: Float64Array | None = None) -> Float64Array | None:
    """Return (3,) of a vector; None where it is declared unknown or not finite."""
    values = vector_of(vector)
    declared_unknown = covariance is not None and covariance[0] == _NOT_KNOWN
    return None if declared_unknown or not (np.abs(values) < _IMPOSSIBLE).all() else values


def _named(names: tuple[str, str, str], values: Float64Array) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


# Pose <-> nav_msgs/Odometry; Pose -> tf2_msgs/TFMessage; Trajectory -> nav_msgs/Path.
#
# The poses of any Odometry, PoseStamped, Path or TFMessage are read with their stamps.

_FARTHEST_M = 1e9


def encode_odometry(
    pose: Pose, base_t_imu: Transform, stamp_ns: int, frames: tuple[str, str]
) -> Odometry:
    """Make an Odometry: the pose of base_link in map, and its motion in base_link.

    Args:
        pose: Pose of imu_link in map.
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
        (stamp_ns_of(pose.header), _checked(transform_of(getattr(pose.pose, 'pose', pose.pose))))
        for pose in getattr(message, 'poses', [message])
    ]


def poses_of_link(message: TFMessage, link: tuple[str, str]) -> list[tuple[int, Transform]]:
    """Decode the transforms of a link (parent, child) in a TFMessage: stamp and parent_T_child.

    Raises:
        ValueError: One of them is invalid.
    """
    # ROS 1 begins names with a slash, which tf2 does not allow.
    transforms = [
        stamped
        for stamped in message.transforms
        if (stamped.header.frame_id.lstrip('/'), stamped.child_frame_id.lstrip('/')) == link
    ]
    decoded = decode_static(TFMessage(transforms))
    return [
        (stamp_ns_of(stamped.header), _checked(transform))
        for stamped, (*_, transform) in zip(transforms, decoded, strict=True)
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


# The numbers of a serialised tf2_msgs/TFMessage, without objects: /tf may have 1000 a second.

_BASE = 4  # the encapsulation header, after which alignment counts


class StampedNumbers(NamedTuple):
    """A transform of a message.

    Attributes:
        stamp_ns: Its stamp, nanoseconds.
        parent, child: Its frames, as they are written.
        numbers: x y z, metres, and x y z w of the quaternion.
    """

    stamp_ns: int
    parent: str
    child: str
    numbers: tuple[float, ...]


def read_transforms(data: bytes | memoryview) -> list[StampedNumbers]:
    """Read the transforms of a TFMessage: a sequence of header, child_frame_id and transform.

    Raises:
        ValueError: The message is truncated.
    """
    order = '<' if data[1:2] == b'\1' else '>'
    head, length, body = (struct.Struct(order + layout) for layout in ('iII', 'I', '7d'))
    links = []
    try:
        (count,) = length.unpack_from(data, _BASE)
        offset = _BASE + length.size
        for _ in range(count):
            offset = _aligned(offset, 4)
            sec, nanosec, size = head.unpack_from(data, offset)
            offset += head.size
            parent, offset = _text(data, offset, size), _aligned(offset + size, 4)
            (size,) = length.unpack_from(data, offset)
            offset += length.size
            child, offset = _text(data, offset, size), _aligned(offset + size, 8)
            numbers = body.unpack_from(data, offset)
            offset += body.size
            links.append(StampedNumbers(from_sec_nanosec(sec, nanosec), parent, child, numbers))
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError(f'a TFMessage of {len(data)} bytes is truncated') from error
    return links


def _aligned(offset: int, size: int) -> int:
    return offset + (_BASE - offset) % size


def _text(data: bytes | memoryview, offset: int, size: int) -> str:
    return bytes(data[offset : offset + size]).rstrip(b'\0').decode()
