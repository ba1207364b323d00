# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The path of the synthetic car: a winding lane in closed form, with exact derivatives.

The *street* frame lies on the ground (z = 0, z up): the ego lane is y = A sin(k x), other lanes
are the same curve shifted in y. In the middle of a bend the car turns at A k^2 times its speed.
The street lies on a slope: map_R_street turns it into map axes (x east, y north, z up), so that
roll, pitch and height change along the way although the car is level on its road and every box
upright beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, atan2, cos, degrees, exp, log, pi, radians, sin, sqrt, tan
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..model.geometry import Transform, rotation_from_rpy, rotation_to_rpy
from ..model.samples import OxtsPacket

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array

_Float = TypeVar('_Float', np.float32, np.float64)

GRAVITY = 9.81
EARTH_RADIUS = 6378137.0
ORIGIN = (49.0093, 8.4381, 114.7)
"""Latitude and longitude in degrees and altitude in metres of the unit in frame 0."""

MAP_R_STREET = rotation_from_rpy(0.011, -0.024, 0.57)

_ACCURACY_AND_MODES = {
    'pos_accuracy': 0.05,
    'vel_accuracy': 0.02,
    'navstat': 4,
    'numsats': 9,
    'posmode': 6,
    'velmode': 6,
    'orimode': 6,
}
_AMPLITUDE = 5.0
_SPEED_WAVE = 0.9
_SPEED_RATE = 0.55
_START_S = 6.0


@dataclass(frozen=True)
class Course:
    """The ego lane, and the car on it.

    Attributes:
        speed: Mean speed along the street, m/s.
        wave_number: k of the lane, radians a metre.
        rest: Time at which the car drives off, seconds; it reaches its speed 6 s later. None: it
            drives from the beginning.
    """

    speed: float = 8.0
    wave_number: float = 2 * pi / 150.0
    rest: float | None = None

    @classmethod
    def turning(cls, speed: float, turn_rate: float, rest: float | None = None) -> Course:
        """Return a course of a speed in m/s, with bends of a turn rate in rad/s."""
        return cls(speed, sqrt(turn_rate / (_AMPLITUDE * speed)), rest)

    def y(self, x: float) -> float:
        """Return the ego lane's y at x, street frame."""
        return _AMPLITUDE * sin(self.wave_number * x)

    def y_array(self, x: npt.NDArray[_Float]) -> npt.NDArray[_Float]:
        """Return y of an array, in its own precision."""
        number, amplitude = x.dtype.type(self.wave_number), x.dtype.type(_AMPLITUDE)
        y: npt.NDArray[_Float] = np.sin(x * number) * amplitude
        return y

    def yaw(self, x: float) -> float:
        """Return the ego lane's heading at x, street frame."""
        return atan(_AMPLITUDE * self.wave_number * cos(self.wave_number * x))

    def ego_x(self, time: float) -> float:
        """Return the car's position along the street at a time in seconds."""
        driven, _, _ = self.driven(time)
        return self.speed * driven + _SPEED_WAVE * sin(_SPEED_RATE * driven)

    def driven(self, time: float) -> tuple[float, float, float]:
        """Return the time for which the car has driven at full speed, and its derivatives."""
        if self.rest is None:
            return time, 1.0, 0.0
        part = min(max((time - self.rest) / _START_S, 0.0), 1.0)
        full = max(time - self.rest - _START_S, 0.0)
        return (
            full + _START_S * (part**3 - part**4 / 2),
            part * part * (3 - 2 * part),
            6 * part * (1 - part) / _START_S,
        )


COURSE = Course()


@dataclass(frozen=True, eq=False)
class Motion:
    """The GPS/IMU unit at one moment; vectors in map axes, from its position at time 0.

    Attributes:
        street_T_car: The car in the street frame.
        map_T_imu: Pose of the unit.
        velocity: (3,) m/s.
        acceleration: (3,) m/s^2, without gravity.
        angular_velocity: (3,) rad/s.
    """

    street_T_car: Transform
    map_T_imu: Transform
    velocity: Float64Array
    acceleration: Float64Array
    angular_velocity: Float64Array


def motion_at(time: float, car_T_imu: Transform, course: Course = COURSE) -> Motion:
    """Return the motion of the unit, mounted at car_T_imu, at a time in seconds."""
    street_t_car, velocity, acceleration, yaw_rate, yaw_acceleration = _car_motion(time, course)
    street_t_imu = street_t_car @ car_T_imu
    first_t_car = _car_motion(0.0, course)[0]
    arm = street_t_imu.translation - street_t_car.translation
    across = np.array([-arm[1], arm[0], 0.0])
    inward = np.array([-arm[0], -arm[1], 0.0])
    moved = street_t_imu.translation - (first_t_car @ car_T_imu).translation
    return Motion(
        street_T_car=street_t_car,
        map_T_imu=Transform(MAP_R_STREET @ street_t_imu.rotation, MAP_R_STREET @ moved),
        velocity=MAP_R_STREET @ (velocity + yaw_rate * across),
        acceleration=MAP_R_STREET
        @ (acceleration + yaw_acceleration * across + yaw_rate**2 * inward),
        angular_velocity=MAP_R_STREET @ np.array([0.0, 0.0, yaw_rate]),
    )


def _car_motion(
    time: float, course: Course
) -> tuple[Transform, Float64Array, Float64Array, float, float]:
    """Return street_T_car, velocity, acceleration, yaw rate and acceleration, street frame."""
    x, wave_number = course.ego_x(time), course.wave_number
    driven, rate, change = course.driven(time)
    speed = course.speed + _SPEED_WAVE * _SPEED_RATE * cos(_SPEED_RATE * driven)
    dx = speed * rate
    ddx = -_SPEED_WAVE * _SPEED_RATE**2 * sin(_SPEED_RATE * driven) * rate**2 + speed * change
    y1 = _AMPLITUDE * wave_number * cos(wave_number * x)
    y2 = -(wave_number**2) * course.y(x)
    y3 = -(wave_number**2) * y1
    steep = 1 + y1 * y1
    yaw_rate = y2 * dx / steep
    yaw_acceleration = (y3 * dx * dx + y2 * ddx) / steep - 2 * y1 * (y2 * dx / steep) ** 2
    pose = Transform(rotation_from_rpy(0.0, 0.0, atan(y1)), np.array([x, course.y(x), 0.0]))
    velocity = np.array([dx, y1 * dx, 0.0])
    acceleration = np.array([ddx, y1 * ddx + y2 * dx * dx, 0.0])
    return pose, velocity, acceleration, yaw_rate, yaw_acceleration


def packet_of(motion: Motion) -> OxtsPacket:
    """Return the unit's packet; the position inverts the devkit's Mercator with frame 0's scale."""
    rotation = motion.map_T_imu.rotation
    roll, pitch, yaw = rotation_to_rpy(rotation)
    level = rotation_from_rpy(0.0, 0.0, yaw).T
    felt = motion.acceleration + np.array([0.0, 0.0, GRAVITY])
    latitude, longitude, altitude = _geodetic(motion.map_T_imu.translation)
    forward, left, up = level @ motion.velocity
    values = [latitude, longitude, altitude, roll, pitch, yaw]
    # vl is positive to the right, as in the real data; see samples.OxtsPacket.
    values += [motion.velocity[1], motion.velocity[0], forward, -left, up]
    values += [*(rotation.T @ felt), *(level @ felt)]
    values += [*(rotation.T @ motion.angular_velocity), *(level @ motion.angular_velocity)]
    return OxtsPacket(
        *(float(value) for value in values),  # type: ignore[arg-type]
        **_ACCURACY_AND_MODES,  # type: ignore[arg-type]
    )


def _geodetic(position: Float64Array) -> tuple[float, float, float]:
    """Return latitude, longitude (degrees) and altitude of a point in map."""
    latitude, longitude, altitude = ORIGIN
    metres = EARTH_RADIUS * cos(radians(latitude))
    northing = log(tan(pi / 4 + radians(latitude) / 2)) + position[1] / metres
    return (
        degrees(2 * atan2(exp(northing), 1.0) - pi / 2),
        longitude + degrees(position[0] / metres),
        altitude + float(position[2]),
    )
