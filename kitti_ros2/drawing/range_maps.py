# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Range images of a scan: one row an elevation, one column an azimuth."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ..options.pictures import ColorBy
from .scales import EMPTY, SCALES

if TYPE_CHECKING:
    from ..model.samples import Float32Array

ROWS = 64
_STEP = np.radians(1.0)
_SAMPLE = 4096
_OUTLIERS = 0.2
"""Percent of the points that may be above and below the rows."""


class RangeMaps(NamedTuple):
    """(H, W) shades of a scan; scales.EMPTY without a return.

    The column in the middle is straight ahead and the left ones are to the left; the first row is
    the highest. Of several points in a cell the nearest is kept.

    Attributes:
        intensity: By reflectance.
        distance: By distance from the scanner.
    """

    intensity: npt.NDArray[np.uint8]
    distance: npt.NDArray[np.uint8]


def range_maps(points: Float32Array, columns: int, rows: int = ROWS) -> RangeMaps:
    """Sort a scan by direction.

    Args:
        points: (N, 4) x y z in velo_link, metres, and reflectance; those that are not finite are
            left out.
        columns: Number of columns of a whole turn.
        rows: Number of rows from the highest to the lowest elevation of the scan.
    """
    x, y, z = points[:, :3].T
    with np.errstate(over='ignore', invalid='ignore'):
        flat = np.hypot(x, y)
        distance = np.hypot(flat, z)
        usable = np.isfinite(distance) & (distance > 0)
    if not usable.all():
        points, flat, distance = points[usable], flat[usable], distance[usable]
        x, y, z = points[:, :3].T
    elevation = np.arctan2(z, flat)
    low, high = _span(elevation)
    row = ((high - elevation) * np.float32(rows / (high - low))).astype(np.int32)
    column = ((np.float32(np.pi) - np.arctan2(y, x)) * np.float32(columns / (2 * np.pi))).astype(
        np.int32
    )
    np.clip(column, 0, columns - 1, out=column)
    inside = (row >= 0) & (row < rows)
    cells = (row * columns + column)[inside]
    near = SCALES[ColorBy.DEPTH].shades(distance[inside])
    # Near is a high shade; NumPy assigns in order, so the nearest of a cell is kept.
    order = np.argsort(near, kind='stable')
    maps = np.full((2, rows * columns), EMPTY, np.uint8)
    maps[0, cells[order]] = SCALES[ColorBy.INTENSITY].shades(points[inside, 3])[order]
    maps[1, cells[order]] = near[order]
    # The scanner's own rows are not quite evenly spaced: an empty cell gets the value above.
    grids = maps.reshape(2, rows, columns)
    between = grids[:, 1:] == EMPTY
    grids[:, 1:][between] = grids[:, :-1][between]
    return RangeMaps(*grids)


def _span(elevation: Float32Array) -> tuple[np.float32, np.float32]:
    """Return lowest and highest elevation of the rows, radians, at least a degree apart."""
    if not len(elevation):
        return np.float32(-_STEP), np.float32(_STEP)
    some = elevation[:: max(len(elevation) // _SAMPLE, 1)]
    low, high = np.percentile(some, [_OUTLIERS, 100 - _OUTLIERS])
    middle, half = (low + high) / 2, max((high - low) / 2, _STEP / 2)
    return np.float32(middle - half), np.float32(middle + half)
