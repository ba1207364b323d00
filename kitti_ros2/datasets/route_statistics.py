# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of the route of the vehicle: length, speed, turn rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.poses import rect_from_imu
from ..model.geometry import Transform
from ..model.route import route_of
from ..model.samples import Pose
from ..model.streams import Clock, Stream
from ..pictures.recording_frames import RecordingFrames
from .distribution import Distribution

if TYPE_CHECKING:
    from ..pictures.frame import FrameSource

SPEEDS_M_S = tuple(range(41))
TURN_RATES_DEG_S = tuple(range(61))


@dataclass
class RouteStatistics:
    """The route of the vehicle; several recordings are added, not joined.

    Attributes:
        poses: Number of poses.
        length_m: Length without jumps. With oxts over the ground, of the GPS/IMU unit; with poses
            of odometry in space, of camera 0: each as KITTI's own tools compute it.
        duration_s: From the first pose to the last; 0 if the recording has no time.
        jumps: Number of steps faster than 100 m/s, which are no part of the route.
        speed_m_s: Speed at each pose; empty if neither speeds nor times are known.
        turn_rate_deg_s: Turn rate at each pose, to the left or right; empty as speed_m_s.
    """

    poses: int = 0
    length_m: float = 0.0
    duration_s: float = 0.0
    jumps: int = 0
    speed_m_s: Distribution = field(default_factory=partial(Distribution, SPEEDS_M_S))
    turn_rate_deg_s: Distribution = field(default_factory=partial(Distribution, TURN_RATES_DEG_S))

    def merge(self, other: RouteStatistics) -> None:
        """Add the route of another recording."""
        self.poses += other.poses
        self.length_m += other.length_m
        self.duration_s += other.duration_s
        self.jumps += other.jumps
        self.speed_m_s.merge(other.speed_m_s)
        self.turn_rate_deg_s.merge(other.turn_rate_deg_s)


class RouteTrace:
    """The poses of a recording, collected frame by frame."""

    def __init__(self, source: FrameSource) -> None:
        self._stamp_of = dict(zip(source.numbers.tolist(), source.stamps_ns.tolist(), strict=True))
        self._stamps: list[int] = []
        self._poses: list[Pose] = []
        self._clock, self._on_ground = Clock.UTC, False
        self._imu_t_sensor = Transform.identity()
        if isinstance(source, RecordingFrames):
            recording = source.recording
            self._clock = recording.clock
            self._on_ground = Stream.POSE not in recording.layout.traits.streams  # by oxts
            if not self._on_ground:
                self._imu_t_sensor = rect_from_imu(recording.calibration(0)).inverse()

    def add(self, number: int, pose: Pose) -> None:
        """Add the pose of a frame."""
        place = (pose.world_T_imu @ self._imu_t_sensor).translation
        moved = Transform(pose.world_T_imu.rotation, place)
        self._stamps.append(self._stamp_of[number])
        self._poses.append(Pose(moved, pose.velocity, pose.angular_velocity))

    def statistics(self) -> RouteStatistics | None:
        """Return the statistics of the route; None for less than two poses."""
        route = route_of(self._stamps, self._poses)
        if route is None:
            return None
        length_m = route.ground_m if self._on_ground else route.length_m
        found = RouteStatistics(len(route.positions), length_m, jumps=route.jumps)
        timed = self._clock is not Clock.NOMINAL
        if timed:
            found.duration_s = route.duration_s
        if timed or route.measured:
            for speed in route.speeds_m_s.tolist():
                found.speed_m_s.add(speed)
            for rate in np.degrees(np.abs(route.turn_rates_rad_s)).tolist():
                found.turn_rate_deg_s.add(rate)
        return found
