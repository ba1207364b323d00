# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a street from a car that drives a bend: scans as measured, and what they would be.

The exact scan is ray-cast at the moment of facing forward. Each of its points is then measured at
the time at which the scanner, in true motion, faces it. Nothing here uses the package's own motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.kitti.find import make_writer
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import Scan, rect_from_velo
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions
from kitti_ros2.synthetic.drive import SyntheticDrive
from kitti_ros2.synthetic.scene import Motion, packet_of

if TYPE_CHECKING:
    from pathlib import Path

FIRST_NS = 1_317_042_000_123_456_789
TURN_S = 0.1036
TURN_NS = 103_600_000
KITTI_TURN_S = 0.1
OXTS_AFTER_NS = 15_000_000
"""Packets come after facing forward, as in KITTI."""

_TILT = rotation_from_rpy(0.011, -0.024, 0.57)
_STEP_S = 1e-4


@dataclass(frozen=True)
class Bend:
    """A motion of the scanner: speed in m/s and turn rate in rad/s at time 0, and their changes."""

    speed: float = 15.0
    rate: float = np.radians(30)
    acceleration: float = 0.0
    turn_acceleration: float = 0.0

    @cached_property
    def _table(self):
        times = np.arange(-1, 3, _STEP_S)
        yaw = self.rate * times + self.turn_acceleration * times**2 / 2
        speed = self.speed + self.acceleration * times
        columns = [times, yaw]
        for slope in (speed * np.cos(yaw), speed * np.sin(yaw)):
            steps = (slope[1:] + slope[:-1]) / 2 * _STEP_S
            columns.append(np.concatenate([[0], np.cumsum(steps)]))
        return columns

    def at(self, times):
        """Yaw, x and y of the scanner in the plane, of times in seconds."""
        known, *columns = self._table
        return [np.interp(times, known, column) for column in columns]

    def pose(self, time):
        """The pose of the scanner in the world, which is tilted."""
        yaw, x, y = self.at(time)
        return Transform(_TILT @ rotation_from_rpy(0, 0, yaw), _TILT @ np.array([x, y, 0]))

    def packet(self, time, velo_t_imu):
        """The packet of the GPS/IMU unit."""
        world_t_imu = self.pose(time) @ velo_t_imu
        yaw, _, _ = self.at(time)
        turning = np.array([0, 0, self.rate + self.turn_acceleration * time])
        driving = (self.speed + self.acceleration * time) * np.array([np.cos(yaw), np.sin(yaw), 0])
        arm = rotation_from_rpy(0, 0, yaw) @ velo_t_imu.translation
        return packet_of(
            Motion(
                street_T_car=Transform.identity(),
                map_T_imu=world_t_imu,
                velocity=_TILT @ (driving + np.cross(turning, arm)),
                acceleration=np.zeros(3),
                angular_velocity=_TILT @ turning,
            )
        )

    def measured(self, exact, forward_s):
        """The points of an exact scan as measured, and whether the scanner faces each at all."""
        yaw0, x0, y0 = self.at(forward_s)
        cos0, sin0 = np.cos(yaw0), np.sin(yaw0)
        x, y = exact[:, 0].astype(np.float64), exact[:, 1].astype(np.float64)
        world = x0 + cos0 * x - sin0 * y, y0 + sin0 * x + cos0 * y
        times = np.full(len(exact), forward_s)
        for _ in range(40):
            yaw, at_x, at_y = self.at(times)
            dx, dy = world[0] - at_x, world[1] - at_y
            ahead = np.cos(yaw) * dx + np.sin(yaw) * dy
            left = np.cos(yaw) * dy - np.sin(yaw) * dx
            before = times
            times = forward_s - np.arctan2(left, ahead) / (2 * np.pi) * TURN_S
        found = exact.copy()
        found[:, 0], found[:, 1] = ahead, left
        return found, np.abs(times - before) < 1e-9

    def moved_by_kitti(self, measured, forward_s):
        """Measured points as the files of odometry have them: by the motion of a turn of 0.1 s."""
        x, y = measured[:, 0].astype(np.float64), measured[:, 1].astype(np.float64)
        parts = -np.arctan2(y, x) / (2 * np.pi)
        angle = parts * KITTI_TURN_S * (self.rate + self.turn_acceleration * forward_s)
        driven = parts * KITTI_TURN_S * (self.speed + self.acceleration * forward_s)
        moved = measured.copy()
        moved[:, 0] = np.cos(angle) * x - np.sin(angle) * y + driven
        moved[:, 1] = np.sin(angle) * x + np.cos(angle) * y
        return moved


def stamp_of(number):
    return FIRST_NS + number * TURN_NS


def write_bend(root: Path, layout: Layout, bend: Bend, frames: int = 4, columns: int = 300):
    """Write a recording; return the folder to convert, and by frame the exact and measured points.

    A layout with compensated scans has them as KITTI compensated: a little less than exact.
    """
    street = SyntheticDrive(
        SyntheticOptions(frames=frames, image_size=(16, 16), lidar_columns=columns)
    )
    rig = street.calibration
    name = layout.traits.default_name.format(date='2011_09_26', kind='sync')
    rect_t_velo = rect_from_velo(rig)
    first = bend.pose(0.0)
    exact, measured = {}, {}
    with make_writer(layout, root, name) as writer:
        writer.write_calibration(0, rig)
        for number in range(frames):
            time = number * TURN_S
            points = street.scan(number).points
            seen, faced = bend.measured(points, time)
            exact[number], measured[number] = points[faced], seen[faced]
            stamp = stamp_of(number)
            points = measured[number]
            if layout.traits.compensated_scans:
                points = bend.moved_by_kitti(points, time)
            bounds = stamp - TURN_NS // 2, stamp + TURN_NS // 2
            writer.write_scan(number, stamp, Scan(points, *bounds))
            if layout.traits.compensated_scans:
                moved = rect_t_velo @ first.inverse() @ bend.pose(time) @ rect_t_velo.inverse()
                writer.write_pose(number, stamp, moved.matrix()[:3])
            else:
                late = OXTS_AFTER_NS if layout is Layout.RAW else 0
                packet = bend.packet(time + late / 1e9, rig.velo_T_imu)
                writer.write_oxts(number, stamp + late, packet)
    folder = root / '2011_09_26' / name if layout.traits.dated else root
    return folder, exact, measured
