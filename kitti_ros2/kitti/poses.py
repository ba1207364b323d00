# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of the vehicle: from oxts packets by Mercator projection, or from odometry's poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..model.geographic import EARTH_RADIUS_M
from ..model.geometry import Transform, rotation_from_rpy
from ..model.nominal import NOMINAL_CAM0_T_VELO
from ..model.samples import Pose

if TYPE_CHECKING:
    from ..model.geographic import GeoOrigin
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration, OxtsPacket

_SCALE_ROUNDS = 12  # each adds a digit at least up to 500 km from the origin


@dataclass(frozen=True, eq=False)
class MercatorWorld:
    """The fixed frame of a recording with oxts: east, north, up from imu_link at its first packet.

    Source: latlonToMercator.m and convertOxtsToPose.m of the raw devkit: Mercator scaled by
    cos(lat0), rotation Rz Ry Rx. The devkit then makes all poses relative to the first one; here
    only the first position is subtracted, as pykitti does, so that the axes stay level.

    Attributes:
        scale: cos(lat0).
        origin: (3,) east, north, up of the first packet, metres.
    """

    scale: float
    origin: Float64Array

    @classmethod
    def at(cls, first: OxtsPacket) -> MercatorWorld:
        """Return the frame whose origin is imu_link in a packet."""
        scale = float(np.cos(np.radians(first.lat)))
        return cls(scale, _mercator(first, scale))

    def pose(self, packet: OxtsPacket) -> Transform:
        """Return world_T_imu of a packet."""
        return Transform(
            rotation_from_rpy(packet.roll, packet.pitch, packet.yaw),
            _mercator(packet, self.scale) - self.origin,
        )


def _mercator(packet: OxtsPacket, scale: float) -> Float64Array:
    """Return (3,) east, north, up of imu_link, metres."""
    east = scale * EARTH_RADIUS_M * np.radians(packet.lon)
    north = scale * EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + np.radians(packet.lat) / 2))
    return np.array([east, north, packet.alt])


def geographic_places(positions: Float64Array, origin: GeoOrigin) -> Float64Array:
    """Return the places of local positions: those that MercatorWorld brings back to them.

    The readers' scale is that of the first packet, so the first position decides it; the plane is
    Mercator's, and distances in it are those of the positions.

    Args:
        positions: (N, 3) east, north, up, metres; the first is that of the first packet.
        origin: The place of (0, 0, 0).

    Returns:
        (N, 3) latitude and longitude, degrees, and altitude, metres.
    """
    north_0 = np.log(np.tan(np.pi / 4 + np.radians(origin.lat) / 2))
    scale = np.cos(np.radians(origin.lat))
    for _ in range(_SCALE_ROUNDS):
        scale = np.cos(_latitude(north_0 + positions[0, 1] / (scale * EARTH_RADIUS_M)))
    east, north, up = positions.T
    radius = scale * EARTH_RADIUS_M
    lat = np.degrees(_latitude(north_0 + north / radius))
    lon = origin.lon + np.degrees(east / radius)
    return np.column_stack([lat, lon, origin.alt + up])


def _latitude(mercator: Float64Array) -> Float64Array:
    """Return latitudes, radians, of Mercator's northings over the radius: the inverse."""
    latitudes: Float64Array = 2 * np.arctan(np.exp(mercator)) - np.pi / 2
    return latitudes


def pose_from_packet(packet: OxtsPacket, world: MercatorWorld) -> Pose:
    """Return the pose and motion of an oxts packet."""
    return Pose(
        world.pose(packet),
        velocity=packet.body_velocity(),
        angular_velocity=np.array([packet.wx, packet.wy, packet.wz]),
        position_sigma=packet.pos_accuracy,
        velocity_sigma=packet.vel_accuracy,
    )


def pose_from_odometry(first_cam0_t_cam0: Float64Array, calibration: Calibration) -> Pose:
    """Return the pose of imu_link from a (3, 4) pose of the rectified camera 0 in its first frame.

    The world is imu_link at the first frame, which is not level: odometry has no gravity.
    """
    rect0_t_imu = rect_from_imu(calibration)
    pose = Transform.from_matrix(first_cam0_t_cam0)
    return Pose(rect0_t_imu.inverse() @ pose @ rect0_t_imu)


def rect_from_imu(calibration: Calibration) -> Transform:
    """Return rect_T_imu, imu_link to the rectified camera 0; nominal without a calibration."""
    rect_r_cam0 = np.eye(3) if calibration.r0_rect is None else calibration.r0_rect
    cam0_t_velo = calibration.cam0_T_velo or NOMINAL_CAM0_T_VELO
    return Transform(rect_r_cam0, np.zeros(3)) @ cam0_t_velo @ calibration.velo_T_imu
