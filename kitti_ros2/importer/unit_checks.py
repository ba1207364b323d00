# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What packets of a GPS/IMU unit say of each other: axes that a driver has otherwise are told.

KITTI's axes are those of REP 103 and REP 145: the orientation is in east-north-up, accelerations
contain gravity, upwards at rest. Drivers with a north-east-down world, a yaw from the start of the
drive, or velocities along other axes name them nowhere. Nor do those that give accelerations in g,
such as Livox'.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kitti.poses import MercatorWorld
from ..messages.header import vector_of
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ..model.geometry import Float64Array
    from ..model.samples import OxtsPacket
    from .topic_survey import TopicSurvey

_GRAVITY = 9.81
_NO_GRAVITY = 3.0
_STANDARD_GRAVITY = 9.80665
_OF_ONE_G = 0.9, 1.1
_OFF_RAD = np.radians(30)
_LEAST_SPEED = 2.0  # m/s; slower, places and their directions are noise
_LEAST_STEPS = 5
_LONGEST_STEP_S = 1.5
_OFF_SHARE = 0.5


def acceleration_unit(imu: TopicSurvey) -> float:
    """Return the m/s^2 of a unit of a topic's accelerations: Livox' drivers give them in g."""
    if 'livox' not in f'{imu.name} {imu.frame}'.lower() or not imu.looks:
        return 1.0
    norms = [float(np.linalg.norm(vector_of(look.linear_acceleration))) for look in imu.looks]
    least, most = _OF_ONE_G
    return _STANDARD_GRAVITY if least <= np.median(norms) <= most else 1.0


def scaled_accelerations(imu: Any, unit: float) -> Any:  # noqa: ANN401 - of the bag's types
    """Return an Imu with accelerations in m/s^2, by the m/s^2 of its unit."""
    told = imu.linear_acceleration
    found = replace(told, x=told.x * unit, y=told.y * unit, z=told.z * unit)
    return replace(imu, linear_acceleration=found)


class UnitChecks:
    """Compares accelerations with gravity, and velocities and headings with the way driven."""

    def __init__(self) -> None:
        self._sensed: list[tuple[float, float, float]] = []
        self._moved: list[tuple[float, ...]] = []
        self._last: tuple[int, OxtsPacket] | None = None
        self._world: MercatorWorld | None = None

    def take(self, stamp_ns: int, packet: OxtsPacket) -> None:
        """Enter the next packet."""
        if packet.ax or packet.ay or packet.az:
            self._sensed.append((packet.af, packet.al, packet.au))
        self._world = self._world or MercatorWorld.at(packet)
        if self._last is not None:
            self._compare(*self._last, stamp_ns, packet)
        self._last = stamp_ns, packet

    def _compare(self, start_ns: int, start: OxtsPacket, end_ns: int, end: OxtsPacket) -> None:
        seconds = (end_ns - start_ns) / NS_PER_S
        if self._world is None or not 0 < seconds <= _LONGEST_STEP_S:
            return
        way = self._world.pose(end).translation - self._world.pose(start).translation
        said = (start.ve + end.ve) / 2, (start.vn + end.vn) / 2
        yaw = np.arctan2(np.sin(start.yaw) + np.sin(end.yaw), np.cos(start.yaw) + np.cos(end.yaw))
        self._moved.append((*(way[:2] / seconds), *said, float(yaw)))

    def notes(self, imu: str, velocity: str, attitude: str) -> Iterator[str]:
        """Yield a note on each that differs.

        Args:
            imu: Topic of the accelerations, empty for none.
            velocity: Topic of the velocities.
            attitude: Topic of the orientation, if it is that of the accelerations.
        """
        if imu and self._sensed:
            yield from self._gravity(imu, attitude)
        moved = np.array(self._moved).reshape(-1, 5)
        fast = moved[np.hypot(moved[:, 0], moved[:, 1]) >= _LEAST_SPEED]
        if len(fast) < _LEAST_STEPS:
            return
        driven, said = fast[:, :2], fast[:, 2:4]
        off = float(np.median(np.hypot(*(driven - said).T)))
        speed = float(np.median(np.hypot(*driven.T)))
        if velocity and off > _OFF_SHARE * speed:
            yield (
                f'{velocity}: its velocities are off by {off:.1f} m/s in the median from the way'
                f' between the places, at {speed:.1f} m/s: are its axes others? (velocity_axes of'
                f' the plan)'
            )
        if attitude:
            yield from self._heading(attitude, fast)

    def _gravity(self, imu: str, attitude: str) -> Iterator[str]:
        forward, left, up = np.mean(self._sensed, axis=0)
        size = float(np.linalg.norm([forward, left, up]))
        least, most = _OF_ONE_G
        if least <= size <= most and abs(up) > size * np.cos(_OFF_RAD):
            yield (
                f'{imu}: its accelerations look like g ({up:.2f} up in the mean, where REP 145 has'
                f' {_GRAVITY} m/s^2), and are written as they are: let the driver give m/s^2, or'
                f' multiply ax to au of oxts by {_STANDARD_GRAVITY}'
            )
        elif not attitude:
            return
        elif size < _NO_GRAVITY:
            yield (
                f'{imu}: its accelerations are without gravity ({size:.1f} m/s^2 in the mean);'
                f" KITTI's contain it (REP 145)"
            )
        elif np.arccos(np.clip(up / size, -1, 1)) > _OFF_RAD:
            yield (
                f'{imu}: by its orientation gravity is {up:.1f} m/s^2 up in the mean, where REP 145'
                f' has {_GRAVITY}: are its axes north-east-down, or those of another frame? KITTI'
                f' has x forward, y left, z up, in east-north-up'
            )

    def _heading(self, imu: str, fast: Float64Array) -> Iterator[str]:
        """Compare the heading with the direction of the way, backwards as well."""
        course = np.arctan2(fast[:, 1], fast[:, 0])
        # Twice the angle: a vehicle drives along its x axis, in either direction.
        off = float(np.median(np.abs(np.angle(np.exp(2j * (course - fast[:, 4])))))) / 2
        if off > _OFF_RAD:
            yield (
                f'{imu}: its heading is {np.degrees(off):.0f} degrees in the median from the'
                f' direction of the way: KITTI has yaw 0 to the east, counted to the left (REP 103)'
            )
