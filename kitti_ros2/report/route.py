# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The route of the vehicle: positions, length, speed and yaw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array, Pose

_STEP_LIMIT_M_S = 100.0


@dataclass(frozen=True, eq=False)
class Route:
    """The route of the vehicle.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        positions: (N, 3) x y z in metres, in map.
        speeds_m_s: (N,) measured, else from positions; NaN where unknown.
        yaws_rad: (N,) from the x axis of map, counter-clockwise, continuous; NaN where unknown.
        jumps: Number of steps faster than 100 m/s; not part of the length.
        length_m: Length without jumps.
        altitude_m: Altitude of z = 0 above sea level; None if unknown.
    """

    stamps_ns: Int64Array
    positions: Float64Array
    speeds_m_s: Float64Array
    yaws_rad: Float64Array
    jumps: int
    length_m: float
    altitude_m: float | None = None

    @property
    def duration_s(self) -> float:
        """Seconds from the first position to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9

    @property
    def net_m(self) -> float:
        """Straight distance in metres from the first position to the last."""
        return float(np.linalg.norm(self.positions[-1] - self.positions[0]))


def route_of(
    stamps_ns: Sequence[int], poses: Sequence[Pose], altitude_m: float | None = None
) -> Route | None:
    """Make the route through poses in map; None for less than two finite positions."""
    stamps = np.array(stamps_ns, dtype=np.int64)
    transforms = [pose.world_T_imu for pose in poses]
    places = np.array([each.translation for each in transforms], np.float64).reshape(-1, 3)
    good = np.isfinite(places).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(stamps[good], kind='stable')]
    if len(order) < 2:
        return None
    stamps, places = stamps[order], places[order]
    turned = np.array([transforms[place].rotation for place in order])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    jumps = steps > np.maximum(np.diff(stamps) / 1e9, 1e-3) * _STEP_LIMIT_M_S
    speeds = _measured([poses[place] for place in order])
    if np.isnan(speeds).all():
        speeds = _derived(stamps, np.where(jumps, np.nan, steps))
    return Route(
        stamps,
        places,
        speeds,
        _continuous(np.arctan2(turned[:, 1, 0], turned[:, 0, 0])),
        int(np.count_nonzero(jumps)),
        float(steps[~jumps].sum()),
        altitude_m,
    )


def _measured(poses: Sequence[Pose]) -> Float64Array:
    """Return the (N,) speeds of poses with a velocity."""
    unknown = np.full(3, np.nan)
    velocities = [unknown if pose.velocity is None else pose.velocity for pose in poses]
    speeds: Float64Array = np.linalg.norm(velocities, axis=1)
    return speeds


def _derived(stamps_ns: Int64Array, steps_m: Float64Array) -> Float64Array:
    """Return the (N,) speeds of steps between N stamps; the first is that of the second."""
    seconds = np.diff(stamps_ns) / 1e9
    speeds = np.divide(steps_m, seconds, out=np.full(len(steps_m), np.nan), where=seconds > 0)
    return np.concatenate([speeds[:1], speeds])


def _continuous(angles_rad: Float64Array) -> Float64Array:
    """Add whole turns so that neighbours differ by half a turn at most."""
    known = np.isfinite(angles_rad)
    angles_rad[known] = np.unwrap(angles_rad[known])
    return angles_rad
