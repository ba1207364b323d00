# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan as whole multiples of 1 mm and 0.01, and what makes its file again of these.

The multiples are those of the file's values, also of scans that KITTI compensated for motion: a
cloud of them is the file within half a millimetre. The file follows bit for bit:

- Of measured scans (raw, object) each value is its multiple, rounded to float32.
- Of compensated ones (odometry) the points of the multiples are taken back to the grid on which
  they were measured by the twist (see scan_grid.py), and compensated again.
- The values of which this is not true are stored: -0.0, NaN, those off the grid, and those of
  points that half a millimetre takes to another point of the grid, 0.6 % in odometry.

No computation decides bits: values of compensated scans that are within _UNSURE_M of the next
float32 are stored too, so that another library of mathematics makes the same file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.local_files import crc32
from ..model.samples import MISSING, CompactScan, Exceptions, ScanRest
from .scan_grid import PER_METRE, PER_REFLECTANCE, compensated, find_twist, measured_near

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array

LARGEST = 2**21
"""Multiples are less: 2 km. Float32 holds them exactly, and so does their product with a step."""

_MOST_EXCEPTIONS = 0.05
"""Of the values of a scan; one with more is no grid."""
_UNSURE_M = 1e-11
_PART = 4 * 32768  # values at once, which stay in the cache
_ROWS = 8192
"""The same of points, with what their motion needs."""
_PER_UNIT = np.tile(np.array([PER_METRE] * 3 + [PER_REFLECTANCE], np.float32), _PART // 4)


def compact(points: Float32Array) -> CompactScan:
    """Round (N, 4) points to multiples, if they are on a grid."""
    file = np.ascontiguousarray(points, '<f4')
    crc = crc32(file.data.cast('B')) if file.size else 0
    rounded = _round_all(file)
    if rounded is None:
        return CompactScan(None, ScanRest(crc))
    multiples, differ, twist = rounded
    exceptions = Exceptions(differ.astype('<u4'), file.reshape(-1).view('<u4')[differ])
    return CompactScan(multiples.reshape(-1, 4), ScanRest(crc, exceptions, twist))


def _round_all(
    file: Float32Array,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.intp], Float64Array | None] | None:
    """Return multiples, the indices of exceptions and the twist; None of a scan that is no grid."""
    values = file.reshape(-1)
    multiples, nearest = np.empty(len(values), np.int32), np.empty_like(values)
    for part in _parts(len(values)):
        if not _round(values[part], multiples[part], nearest[part]):
            return None
    twist = None
    differs = _different(values, nearest)
    if _are_too_many(differs):
        twist = find_twist(file)
        if twist is None:
            return None
        differs.reshape(-1, 4)[:, :3] = _compensate(nearest, twist, values)
        if _are_too_many(differs):
            return None
    return multiples, np.flatnonzero(differs), twist


def _are_too_many(exceptions: npt.NDArray[np.bool_]) -> bool:
    return bool(np.count_nonzero(exceptions) > _MOST_EXCEPTIONS * len(exceptions))


def restore(points: Float32Array, rest: ScanRest) -> Float32Array:
    """Return the (N, 4) points of the file of rounded ones, or of those of the file: both give it.

    Raises:
        ValueError: They do not give the file that the rest is of.
    """
    values: Float32Array = np.array(points, '<f4').reshape(-1)
    if rest.exceptions is not None:
        _restore_rounded(values, rest.exceptions, rest.twist)
    if (crc32(values.data.cast('B')) if values.size else 0) != rest.crc:
        raise ValueError('the points do not give the CRC-32 of the file')
    return values.reshape(-1, 4)


def _restore_rounded(
    values: Float32Array, exceptions: Exceptions, twist: Float64Array | None
) -> None:
    if len(exceptions.indices) and exceptions.indices[-1] >= len(values):
        raise ValueError('the points are fewer than those of the file')
    with np.errstate(all='ignore'):
        for part in _parts(len(values)):
            scale = _PER_UNIT[: len(values[part])]
            np.multiply(values[part], scale, out=values[part])
            np.rint(values[part], out=values[part])
            values[part] += 0  # of -0.0
            np.divide(values[part], scale, out=values[part])
    if twist is not None:
        _compensate(values, twist)
    values.view('<u4')[exceptions.indices] = exceptions.bits


def _parts(count: int) -> Iterator[slice]:
    return (slice(first, first + _PART) for first in range(0, count, _PART))


def _round(values: Float32Array, multiples: npt.NDArray[np.int32], nearest: Float32Array) -> bool:
    """Enter multiples of values, and the values that these stand for; False if one is too large."""
    scale = _PER_UNIT[: len(values)]
    with np.errstate(over='ignore', invalid='ignore'):
        np.multiply(values, scale, out=nearest)
    np.rint(nearest, out=nearest)
    nearest += 0  # of -0.0
    # float32 divides two whole numbers of its own as exactly as it holds decimals of a text.
    if nearest.min() > -LARGEST and nearest.max() < LARGEST:
        multiples[:] = nearest
        np.divide(nearest, scale, out=nearest)
        return True
    missing = np.isnan(nearest)
    nearest[missing] = 0
    if nearest.min() <= -LARGEST or nearest.max() >= LARGEST:
        return False
    multiples[:] = nearest
    multiples[missing] = MISSING
    np.divide(nearest, scale, out=nearest)
    nearest[missing] = np.nan
    return True


def _different(values: Float32Array, nearest: Float32Array) -> npt.NDArray[np.bool_]:
    """Return which values have other bits, and all NaN, which have many."""
    differs: npt.NDArray[np.bool_] = values.view('<u4') != nearest.view('<u4')
    differs |= np.isnan(values)
    return differs


def _compensate(
    values: Float32Array, twist: Float64Array, file: Float32Array | None = None
) -> npt.NDArray[np.bool_]:
    """Compensate the x, y, z of values again from the grid, in place.

    Returns:
        (N, 3) which coordinates differ from those of a file, or are not sure not to with another
        library of mathematics; none without a file.
    """
    rows = values.reshape(-1, 4)
    own = rows.view('<u4') if file is None else file.view('<u4').reshape(-1, 4)
    differs = np.zeros((len(rows), 3), bool)
    for first in range(0, len(rows), _ROWS):
        part = slice(first, first + _ROWS)
        finite = np.isfinite(rows[part, :3]).all(axis=1)
        if finite.all():
            differs[part] = _compensate_part(rows[part, :3], twist, own[part, :3])
            continue
        points = rows[part][finite, :3]
        differs[part] = True
        differs[part][finite] = _compensate_part(points, twist, own[part][finite, :3])
        rows[part][finite, :3] = points
    return differs


def _compensate_part(
    points: Float32Array, twist: Float64Array, file: npt.NDArray[np.uint32]
) -> npt.NDArray[np.bool_]:
    """Compensate finite (N, 3) points in place; return which are not surely the bits of a file."""
    exact = compensated(measured_near(points, twist), twist)
    points[:] = exact
    unsure: npt.NDArray[np.bool_] = (exact - _UNSURE_M).astype(np.float32) != points
    unsure |= (exact + _UNSURE_M).astype(np.float32) != points
    unsure |= points.view('<u4') != file
    return unsure
