# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle is: from oxts packets by Mercator projection, or from odometry's poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..geometry import Transform, rotation_from_rpy
from ..samples import Pose
from .calib_file import NOMINAL_CAM0_T_VELO

if TYPE_CHECKING:
    from ..geometry import Float64Array
    from ..samples import Calibration, OxtsPacket

EARTH_RADIUS_M = 6378137.0


@dataclass(frozen=True, eq=False)
class MercatorMap:
    """The map frame of a recording with oxts: imu_link at its first packet.

    Source: convertOxtsToPose.m and latlonToMercator.m of the raw devkit: Mercator scaled by
    cos(lat0), rotation Rz Ry Rx, relative to the first pose.
    """

    scale: float
    map_T_mercator: Transform

    @classmethod
    def at(cls, first: OxtsPacket) -> MercatorMap:
        """The map whose origin and axes are those of imu_link in a packet."""
        scale = float(np.cos(np.radians(first.lat)))
        return cls(scale, _mercator_t_imu(first, scale).inverse())

    def pose(self, packet: OxtsPacket) -> Transform:
        """map_T_imu of a packet."""
        return self.map_T_mercator @ _mercator_t_imu(packet, self.scale)


def _mercator_t_imu(packet: OxtsPacket, scale: float) -> Transform:
    """imu_link in east, north, up metres."""
    east = scale * EARTH_RADIUS_M * np.radians(packet.lon)
    north = scale * EARTH_RADIUS_M * np.log(np.tan(np.pi / 4 + np.radians(packet.lat) / 2))
    return Transform(
        rotation_from_rpy(packet.roll, packet.pitch, packet.yaw),
        np.array([east, north, packet.alt]),
    )


def pose_from_packet(packet: OxtsPacket, map_: MercatorMap) -> Pose:
    """The pose and motion that an oxts packet tells."""
    return Pose(
        map_.pose(packet),
        velocity=packet.body_velocity(),
        angular_velocity=np.array([packet.wx, packet.wy, packet.wz]),
        position_sigma=packet.pos_accuracy,
        velocity_sigma=packet.vel_accuracy,
    )


def pose_from_odometry(first_cam0_t_cam0: Float64Array, calibration: Calibration) -> Pose:
    """The pose of imu_link from a (3, 4) pose of the rectified camera 0 in its first frame.

    The map is imu_link at the first frame; the camera's mounting is taken from the calibration,
    or its nominal place where that does not tell.
    """
    rect_r_cam0 = np.eye(3) if calibration.r0_rect is None else calibration.r0_rect
    cam0_t_velo = calibration.cam0_T_velo or NOMINAL_CAM0_T_VELO
    rect0_t_imu = Transform(rect_r_cam0, np.zeros(3)) @ cam0_t_velo @ calibration.velo_T_imu
    pose = Transform.from_matrix(first_cam0_t_cam0)
    return Pose(rect0_t_imu.inverse() @ pose @ rect0_t_imu)
