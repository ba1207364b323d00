# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Velocities of a vehicle from its places over time, where no message of a bag has any.

A parabola is fitted to the places near each moment, so that a steady acceleration is met, also at
the ends. What a vehicle moves within the scatter of the places is no motion: a standing one has the
velocity 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.geographic import EARTH_RADIUS_M
from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

SLOWEST_FIX_M_S = 0.2
"""Places of a standing receiver wander by some 0.1 m a second."""
SLOWEST_POSE_M_S = 0.02

_WINDOW_NS = NS_PER_S // 2
_WINDOW_PERIODS = 1.5
_WIDENINGS = (1, 2, 4)
_SIGMAS = 5.0
_CLEAR_M_S = 0.5
"""Where scatter looks faster, a wider window tells a slow vehicle from a standing one."""
_GLITCH, _GLITCH_M = 10.0, 2.0  # of the usual distance, and metres more
_PARABOLA = 2
_DIFFERENCES = 3
_EVEN = 1.2
_GROWTH = np.sqrt(20)  # of a standard deviation in third differences: 1, 3, 3, 1
_SIGMA_OF_MEDIAN = 1.4826  # of a normal distribution, by the median of absolute values


def metres_of(fixes: Float64Array) -> Float64Array:
    """Return (N, 3) metres east, north, up of the first of (N, 3) places, on KITTI's sphere.

    Args:
        fixes: Latitude and longitude in degrees, altitude in metres, of which some may be NaN.
    """
    if not len(fixes):
        return np.zeros((0, 3))
    lat, lon, alt = fixes.T
    radius_m = EARTH_RADIUS_M * np.cos(np.radians(lat))
    east = np.radians(np.unwrap(lon, period=360.0) - lon[0]) * radius_m
    north = np.radians(lat - lat[0]) * EARTH_RADIUS_M
    return np.column_stack([east, north, np.nan_to_num(alt - np.nanmin(alt, initial=1e9))])


class DerivedVelocities:
    """The velocities of a vehicle by its places, each computed when it is asked for.

    Args:
        stamps_ns: (N,) of the places, ascending.
        places: (N, 3) metres.
        most_ns: A longer gap between two places is not bridged; nor is a moment known that is
            farther from any place.
        slowest: Slower than this, m/s, the vehicle stands.
    """

    def __init__(
        self, stamps_ns: Int64Array, places: Float64Array, most_ns: int, slowest: float
    ) -> None:
        kept = ~_glitches(stamps_ns, places)
        stamps_ns, places = stamps_ns[kept], places[kept]
        self._stamps_ns = stamps_ns
        self._places = places
        self._most_ns = most_ns
        self._slowest = slowest
        steps = np.diff(stamps_ns)
        self._scatter = _scatter_of(places, steps)
        usual = float(np.median(steps)) if len(steps) else 0.0
        self._window_ns = max(_WINDOW_NS, round(_WINDOW_PERIODS * usual))
        self._starts = np.flatnonzero(np.concatenate([[True], steps > most_ns]))

    def at(self, moment_ns: int) -> Float64Array | None:
        """Return (3,) m/s along the axes of the places at a moment, None where it is not known."""
        stamps = self._stamps_ns
        if len(stamps) < _PARABOLA:
            return None
        after = int(np.searchsorted(stamps, moment_ns))
        around = range(max(after - 1, 0), min(after + 1, len(stamps)))
        nearest = min(around, key=lambda place: abs(int(stamps[place]) - moment_ns))
        run = int(np.searchsorted(self._starts, nearest, 'right'))
        begin = int(self._starts[run - 1])
        end = int(self._starts[run]) if run < len(self._starts) else len(stamps)
        if end - begin < _PARABOLA or abs(int(stamps[nearest]) - moment_ns) > self._most_ns:
            return None
        seconds = (stamps[begin:end] - moment_ns) / NS_PER_S
        for times in _WIDENINGS:
            first, last = _near(seconds, times * self._window_ns / NS_PER_S)
            places = self._places[begin + first : begin + last]
            velocity, blur = _slope(seconds[first:last], places, self._scatter)
            if np.hypot(*velocity[:2]) > max(self._slowest, blur):
                return velocity
            if blur <= _CLEAR_M_S:
                break
        return np.zeros(3)


def _glitches(stamps_ns: Int64Array, places: Float64Array) -> npt.NDArray[np.bool_]:
    """Return (N,) which single places lie far off the way between their neighbours."""
    aside = np.zeros(len(places))
    if len(places) <= _DIFFERENCES:
        return aside > 0
    there = places[:, :2]
    share = (np.diff(stamps_ns)[:-1] / np.maximum(stamps_ns[2:] - stamps_ns[:-2], 1))[:, None]
    way = there[:-2] + share * (there[2:] - there[:-2])
    aside[1:-1] = np.linalg.norm(there[1:-1] - way, axis=1)
    most = np.lib.stride_tricks.sliding_window_view(np.pad(aside, 1), _DIFFERENCES).max(axis=1)
    limit = _GLITCH_M + _GLITCH * float(np.median(aside))
    far: npt.NDArray[np.bool_] = (aside > limit) & (aside == most)
    return far


def _near(seconds: Float64Array, window: float) -> tuple[int, int]:
    """Return the first, and the end, of the times around 0 s; at least two."""
    first, last = np.searchsorted(seconds, [-window, window + 1e-9]).tolist()
    if last - first < _PARABOLA:
        first = max(min(first - 1, len(seconds) - _PARABOLA), 0)
        last = first + _PARABOLA
    return first, last


def _scatter_of(places: Float64Array, steps: Int64Array) -> float:
    """Return the standard deviation of places on the ground about their course, metres.

    Third differences of evenly spaced places are free of a steady acceleration; others are not.
    """
    if len(steps) < _DIFFERENCES:
        return 0.0
    around = np.lib.stride_tricks.sliding_window_view(steps, _DIFFERENCES)
    even = around.max(axis=1) <= _EVEN * around.min(axis=1)
    jumps = np.abs(np.diff(places[:, :2], _DIFFERENCES, axis=0))[even]
    return float(_SIGMA_OF_MEDIAN * np.median(jumps) / _GROWTH) if jumps.size else 0.0


def _slope(
    seconds: Float64Array, places: Float64Array, known_scatter: float
) -> tuple[Float64Array, float]:
    """Return (3,) the velocity at 0 s, and the speed up to which it is scatter of the places."""
    degree = min(_PARABOLA, len(seconds) - 1)
    powers = np.vander(seconds, degree + 1, increasing=True)
    middle = places.mean(axis=0)  # maps may be far from their origin
    inverse = np.linalg.pinv(powers)
    parts = inverse @ (places - middle)
    rest = places - middle - powers @ parts
    freedom = 2 * max(len(seconds) - degree - 1, 1)
    scatter = max(known_scatter, float(np.sqrt((rest[:, :2] ** 2).sum() / freedom)))
    return parts[1], _SIGMAS * scatter * float(np.linalg.norm(inverse[1]))
