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
    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

SLOWEST_FIX_M_S = 0.2
"""Places of a standing receiver wander by some 0.1 m a second."""
SLOWEST_POSE_M_S = 0.02

_WINDOW_NS = NS_PER_S // 2
_WINDOW_PERIODS = 1.5
_SIGMAS = 5.0
_PARABOLA = 2


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


def velocities_at(
    stamps_ns: Int64Array,
    places: Float64Array,
    wanted_ns: Int64Array,
    most_ns: int,
    slowest: float,
) -> Float64Array:
    """Return (M, 3) velocities, m/s along the axes of the places; NaN where they are not known.

    Args:
        stamps_ns: (N,) of the places, ascending.
        places: (N, 3) metres.
        wanted_ns: (M,) moments.
        most_ns: A longer gap between two places is not bridged; nor is a moment known that is
            farther from any place.
        slowest: Slower than this, m/s, the vehicle stands.
    """
    found = np.full((len(wanted_ns), 3), np.nan)
    if len(stamps_ns) < _PARABOLA:
        return found
    steps = np.diff(stamps_ns)
    window_ns = max(_WINDOW_NS, round(_WINDOW_PERIODS * float(np.median(steps))))
    starts = np.flatnonzero(np.concatenate([[True], steps > most_ns]))
    ends = np.append(starts[1:], len(stamps_ns))
    for row, moment_ns in enumerate(wanted_ns.tolist()):
        after = int(np.searchsorted(stamps_ns, moment_ns))
        nearest = min(
            range(max(after - 1, 0), min(after + 1, len(stamps_ns))),
            key=lambda place: abs(int(stamps_ns[place]) - moment_ns),
        )
        run = int(np.searchsorted(starts, nearest, 'right')) - 1
        first, last = _near(
            stamps_ns[starts[run] : ends[run]] - (moment_ns - window_ns), 2 * window_ns
        )
        first, last = first + int(starts[run]), last + int(starts[run])
        if last - first >= _PARABOLA and abs(int(stamps_ns[nearest]) - moment_ns) <= most_ns:
            seconds = (stamps_ns[first:last] - moment_ns) / NS_PER_S
            found[row] = _slope(seconds, places[first:last], slowest)
    return found


def _near(since_ns: Int64Array, length_ns: int) -> tuple[int, int]:
    """Return the first, and the end, of the stamps of a window; at least two where there are."""
    first, last = np.searchsorted(since_ns, [0, length_ns + 1]).tolist()
    if last - first < _PARABOLA:
        first = max(min(first - 1, len(since_ns) - _PARABOLA), 0)
        last = min(first + _PARABOLA, len(since_ns))
    return first, last


def _slope(seconds: Float64Array, places: Float64Array, slowest: float) -> Float64Array:
    """Return (3,) the velocity at 0 s; 0 where it is within the scatter of the places."""
    degree = min(_PARABOLA, len(seconds) - 1)
    powers = np.vander(seconds, degree + 1, increasing=True)
    middle = places.mean(axis=0)  # maps may be far from their origin
    inverse = np.linalg.pinv(powers)
    parts = inverse @ (places - middle)
    rest = places - middle - powers @ parts
    freedom = 2 * max(len(seconds) - degree - 1, 1)
    scatter = np.sqrt((rest[:, :2] ** 2).sum() / freedom) * np.linalg.norm(inverse[1])
    if np.hypot(*parts[1, :2]) <= max(slowest, _SIGMAS * scatter):
        return np.zeros(3)
    return np.asarray(parts[1])
