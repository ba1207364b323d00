# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic scanner: 64 rows ray-cast against the ground and upright boxes.

A ray leaves the scanner's origin along (cos az, sin az, tan el) and is measured by its horizontal
range. So a box's four walls depend on the column alone and its top and bottom on the
row alone, so the slab test is one line a column and one comparison a ray.
"""

from __future__ import annotations

from math import atan2, ceil, floor, hypot, pi
from typing import TYPE_CHECKING

import numpy as np

from .rig import SCANNER_HEIGHT
from .scene import ROAD_CENTRE, ROAD_LEFT, ROAD_RIGHT

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array, Transform
    from ..model.samples import Float32Array
    from .path import Course
    from .scene import PlacedSolid

ELEVATIONS = np.radians(
    np.concatenate([np.linspace(2.0, -8.33, 32), np.linspace(-8.87, -24.8, 32)])
)
"""Elevations of the 64 rows, top to bottom, radians: the upper half denser, as on an HDL-64E."""

MAX_RANGE = 120.0
_TANGENTS = np.tan(ELEVATIONS)
_GROUND = -1
_GROUND_RANGES: Float64Array = np.array(
    [-SCANNER_HEIGHT / tangent if tangent < 0 else np.inf for tangent in _TANGENTS]
)


def cast_scan(
    placed: Sequence[PlacedSolid], columns: int
) -> tuple[Float64Array, npt.NDArray[np.int64]]:
    """Cast every ray.

    Args:
        placed: The boxes, in velo_link.
        columns: Rays a row; column c looks at azimuth (c + 1/2) / columns of a turn.

    Returns:
        (64, columns) horizontal range in metres, infinite for a miss; and the index into placed of
        the box hit, -1 for the ground.
    """
    ranges = np.repeat(_GROUND_RANGES[:, None], columns, axis=1)
    hits = np.full(ranges.shape, _GROUND, dtype=np.int64)
    for index, one in enumerate(placed):
        for part in _column_slices(one, columns):
            azimuths = column_azimuths(columns)[part]
            nearer = _cast_box(one, azimuths)
            closer = nearer < ranges[:, part]
            np.copyto(ranges[:, part], nearer, where=closer)
            np.copyto(hits[:, part], index, where=closer)
    return ranges, hits


def column_azimuths(columns: int) -> Float64Array:
    """Return (columns,) azimuths in radians, counter-clockwise from just left of straight ahead."""
    azimuths: Float64Array = (np.arange(columns, dtype=np.float64) + 0.5) * (2 * pi / columns)
    return azimuths


def scan_points(
    ranges: Float64Array, reflectance: Float64Array, noise: Float64Array | None
) -> Float32Array:
    """Return (N, 4) float32 points in KITTI's order: by row, each from straight ahead to the left.

    Rays without a return within range are left out.

    Args:
        ranges: (64, columns) horizontal range, metres.
        reflectance: (64, columns), 0..1.
        noise: (64, columns), added to the slant range, metres, or None.
    """
    slant = np.sqrt(1 + _TANGENTS * _TANGENTS)[:, None]
    kept = ranges * slant <= MAX_RANGE
    if noise is not None:
        ranges = ranges + noise / slant
    azimuths = column_azimuths(ranges.shape[1])
    with np.errstate(invalid='ignore'):
        stacked = (
            ranges * np.cos(azimuths),
            ranges * np.sin(azimuths),
            ranges * _TANGENTS[:, None],
            np.clip(reflectance, 0.0, 0.99).round(2),
        )
    return np.stack([values[kept] for values in stacked], axis=1).astype(np.float32)


def ground_reflectance(
    ranges: Float64Array, street_T_velo: Transform, course: Course
) -> Float64Array:
    """Return the (rows, columns) reflectance of the ground: asphalt, paint, pavement."""
    azimuths = column_azimuths(ranges.shape[1])
    reached = np.where(np.isfinite(ranges), ranges, 0.0)
    rotation, origin = street_T_velo.rotation, street_T_velo.translation
    cosines, sines = np.cos(azimuths), np.sin(azimuths)
    x = origin[0] + reached * (rotation[0, 0] * cosines + rotation[0, 1] * sines)
    y = origin[1] + reached * (rotation[1, 0] * cosines + rotation[1, 1] * sines)
    across = y - course.y_array(x)
    on_road = (across > ROAD_RIGHT) & (across < ROAD_LEFT)
    dashed = (np.abs(across - ROAD_CENTRE) < 0.08) & (x % 12 < 6)
    reflectance: Float64Array = np.where(dashed, 0.7, np.where(on_road, 0.2, 0.35))
    return reflectance


def _column_slices(one: PlacedSolid, columns: int) -> list[slice]:
    """Return the columns that can see a box: two slices if it covers straight ahead."""
    middle = atan2(one.centre[1], one.centre[0])
    corners = [
        (atan2(y, x) - middle + pi) % (2 * pi) - pi
        for x, y in one.footprint()
    ]  # fmt: skip
    per_radian = columns / (2 * pi)
    first = floor((middle + min(corners)) * per_radian - 0.5)
    last = ceil((middle + max(corners)) * per_radian - 0.5) + 1
    if last - first >= columns:
        return [slice(0, columns)]
    first, last = first % columns, (last - 1) % columns + 1
    if first < last:
        return [slice(first, last)]
    return [slice(first, columns), slice(0, last)]


def _cast_box(one: PlacedSolid, azimuths: Float64Array) -> Float64Array:
    """Return the (64, len(azimuths)) horizontal range to a box, infinite for a miss."""
    enter, leave = _cast_walls(one, azimuths)
    low = one.centre[2]
    high = low + one.solid.size[2]
    tangents = _TANGENTS[:, None]
    at_wall = tangents * enter
    hit = np.where((low <= at_wall) & (at_wall <= high), enter, np.inf)
    with np.errstate(divide='ignore', invalid='ignore'):
        for lid, passes in ((high, at_wall > high), (low, at_wall < low)):
            at_lid = lid / tangents
            reached = passes & (at_lid > enter) & (at_lid <= leave)
            hit = np.where(reached, at_lid, hit)
    return np.where(enter <= leave, hit, np.inf)


def _cast_walls(one: PlacedSolid, azimuths: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return, by azimuth, the ranges at which a ray enters and leaves a box's footprint."""
    x, y, _ = one.centre
    distance, bearing = hypot(x, y), atan2(y, x) - one.yaw
    enter = np.zeros(len(azimuths))
    leave = np.full(len(azimuths), np.inf)
    along = (np.cos(azimuths - one.yaw), np.cos(bearing), one.solid.size[0] / 2)
    across = (np.sin(azimuths - one.yaw), np.sin(bearing), one.solid.size[1] / 2)
    with np.errstate(divide='ignore'):
        for direction, centre, half in (along, across):
            one_side = (centre * distance - half) / direction
            other_side = (centre * distance + half) / direction
            enter = np.maximum(enter, np.minimum(one_side, other_side))
            leave = np.minimum(leave, np.maximum(one_side, other_side))
    return enter, leave
