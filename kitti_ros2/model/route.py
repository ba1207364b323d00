# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The route of the vehicle: positions, length, speed, yaw and turn rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .geometry import Float64Array
    from .samples import Int64Array, Pose

_STEP_LIMIT_M_S = 100.0


@dataclass(frozen=True, eq=False)
class Route:
    """The route of the vehicle.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        positions: (N, 3) x y z in metres, in map.
        speeds_m_s: (N,) measured, else from positions; NaN where unknown.
        measured: Whether speeds are measured; those from positions need the true stamps.
        yaws_rad: (N,) from the x axis of map, counter-clockwise, continuous; NaN where unknown.
        turn_rates_rad_s: (N,) about the z axis of map, counter-clockwise, measured, else from yaws;
            NaN where unknown.
        jumps: Number of steps faster than 100 m/s; not part of the length.
        length_m: Length without jumps.
        ground_m: The same without heights.
        altitude_m: Altitude of z = 0 above sea level; None if unknown.
    """

    stamps_ns: Int64Array
    positions: Float64Array
    speeds_m_s: Float64Array
    measured: bool
    yaws_rad: Float64Array
    turn_rates_rad_s: Float64Array
    jumps: int
    length_m: float
    ground_m: float
    altitude_m: float | None = None

    @property
    def duration_s(self) -> float:
        """Seconds from the first position to the last."""
        return float(self.stamps_ns[-1] - self.stamps_ns[0]) / 1e9

    @property
    def net_m(self) -> float:
        """Straight distance in metres from the first position to the last."""
        with np.errstate(over='ignore'):
            return float(np.linalg.norm(self.positions[-1] - self.positions[0]))


@np.errstate(over='ignore', invalid='ignore')  # poses may hold any numbers
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
    offsets = np.diff(places, axis=0)
    steps = np.linalg.norm(offsets, axis=1)
    jumps = steps > np.maximum(np.diff(stamps) / 1e9, 1e-3) * _STEP_LIMIT_M_S
    chosen = [poses[place] for place in order]
    speeds = np.linalg.norm([_known(pose.velocity) for pose in chosen], axis=1)
    measured = not np.isnan(speeds).all()
    if not measured:
        speeds = _derived(stamps, np.where(jumps, np.nan, steps))
    yaws = _continuous(np.arctan2(turned[:, 1, 0], turned[:, 0, 0]))
    rates = [_known(pose.angular_velocity) for pose in chosen]
    turn_rates = np.einsum('ij,ij->i', turned[:, 2], np.array(rates))  # z of world_R_imu @ rate
    if np.isnan(turn_rates).all():
        turn_rates = _derived(stamps, np.where(jumps, np.nan, np.diff(yaws)))
    return Route(
        stamps,
        places,
        speeds,
        measured,
        yaws,
        turn_rates,
        int(np.count_nonzero(jumps)),
        float(steps[~jumps].sum()),
        float(np.linalg.norm(offsets[~jumps, :2], axis=1).sum()),
        altitude_m,
    )


def _known(rate: Float64Array | None) -> Float64Array:
    """Return the (3,) velocity or angular velocity of a pose, NaN without one."""
    return np.full(3, np.nan) if rate is None else rate


def _derived(stamps_ns: Int64Array, steps: Float64Array) -> Float64Array:
    """Return the (N,) rates a second of steps between N stamps; the first is that of the second."""
    seconds = np.diff(stamps_ns) / 1e9
    rates = np.divide(steps, seconds, out=np.full(len(steps), np.nan), where=seconds > 0)
    return np.concatenate([rates[:1], rates])


def _continuous(angles_rad: Float64Array) -> Float64Array:
    """Add whole turns so that neighbours differ by half a turn at most."""
    known = np.isfinite(angles_rad)
    angles_rad[known] = np.unwrap(angles_rad[known])
    return angles_rad
