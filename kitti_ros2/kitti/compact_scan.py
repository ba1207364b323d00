# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan as whole multiples of 1 mm and 0.01, and what makes its file again of these.

The multiples are those of the file's values, also of scans that KITTI compensated for motion: a
cloud of them is the file within half a millimetre. The file follows bit for bit:

- Of measured scans (raw, object) each value is its multiple, rounded to float32.
- Of compensated ones (odometry) the points of the multiples are taken back to the grid on which
  they were measured by the twist (see scan_grid.py), and compensated again. Of points that half a
  millimetre takes to another one of the grid (1 to 4 %), the steps to their own are stored.
- The values of which this is not true are stored: -0.0, NaN, those off the grid.

No computation decides bits: values of compensated scans that are within _UNSURE_M of the next
float32 are stored too, so that another library of mathematics makes the same file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..files.local_files import crc32
from ..model.samples import MISSING, CompactScan, Exceptions, GridSteps, ScanRest
from .scan_grid import (
    PER_METRE,
    PER_REFLECTANCE,
    compensated_axes,
    find_twist,
    measured,
    moves_back,
    on_grid,
)

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
_MOST_STEPS = 127
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
    multiples, differ, moved = rounded
    exceptions = Exceptions(differ.astype('<u4'), file.reshape(-1).view('<u4')[differ])
    return CompactScan(multiples.reshape(-1, 4), ScanRest(crc, exceptions, *moved))


def _round_all(
    file: Float32Array,
) -> (
    tuple[npt.NDArray[np.int32], npt.NDArray[np.intp], tuple[Float64Array, GridSteps] | tuple[()]]
    | None
):
    """Return multiples, indices of exceptions, twist and steps; None of a scan that is no grid."""
    values = file.reshape(-1)
    multiples, nearest = np.empty(len(values), np.int32), np.empty_like(values)
    for part in _parts(len(values)):
        if not _round(values[part], multiples[part], nearest[part]):
            return None
    differs = _different(values, nearest)
    if not _are_too_many(differs):
        return multiples, np.flatnonzero(differs), ()
    twist = find_twist(file)
    if twist is None:
        return None
    steps, differs.reshape(-1, 4)[:, :3] = _compare(nearest.reshape(-1, 4), twist, file)
    if _are_too_many(differs):
        return None
    return multiples, np.flatnonzero(differs), (twist, steps)


def _are_too_many(exceptions: npt.NDArray[np.bool_]) -> bool:
    return bool(np.count_nonzero(exceptions) > _MOST_EXCEPTIONS * len(exceptions))


def restore(points: Float32Array, rest: ScanRest) -> Float32Array:
    """Return the (N, 4) points of the file of rounded ones, or of those of the file: both give it.

    Raises:
        ValueError: They do not give the file that the rest is of.
    """
    values: Float32Array = np.array(points, '<f4').reshape(-1)
    if rest.exceptions is not None:
        with np.errstate(all='ignore'):
            _restore_rounded(values, rest.exceptions, rest)
    if (crc32(values.data.cast('B')) if values.size else 0) != rest.crc:
        raise ValueError('the points do not give the CRC-32 of the file')
    return values.reshape(-1, 4)


def _restore_rounded(values: Float32Array, exceptions: Exceptions, rest: ScanRest) -> None:
    if _is_beyond(exceptions.indices, len(values)):
        raise ValueError('the points are fewer than those of the file')
    for part in _parts(len(values)):
        scale = _PER_UNIT[: len(values[part])]
        np.multiply(values[part], scale, out=values[part])
        np.rint(values[part], out=values[part])
        values[part] += 0  # of -0.0
        np.divide(values[part], scale, out=values[part])
    if rest.twist is not None:
        _compensate(values.reshape(-1, 4), rest.twist, rest.steps)
    values.view('<u4')[exceptions.indices] = exceptions.bits


def _is_beyond(indices: npt.NDArray[np.uint32], count: int) -> bool:
    return bool(len(indices) and indices[-1] >= count)


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


def _compensate(rows: Float32Array, twist: Float64Array, steps: GridSteps | None) -> None:
    """Compensate the x, y, z of (N, 4) values on the grid again, in place."""
    beside = np.zeros((len(rows), 3), np.float32)
    if steps is not None:
        if _is_beyond(steps.indices, beside.size):
            raise ValueError('the points are fewer than those of the file')
        beside.reshape(-1)[steps.indices] = steps.steps
    for part in _row_parts(len(rows)):
        axes = _measured(rows[part, :3], twist, beside[part])
        rows[part, :3] = compensated_axes(axes.astype(np.float64), twist).T


def _compare(
    rows: Float32Array, twist: Float64Array, file: Float32Array
) -> tuple[GridSteps, npt.NDArray[np.bool_]]:
    """Find what compensating (N, 4) values on the grid again leaves to be stored.

    Returns:
        Steps, and (N, 3) which coordinates differ from those of a file with them, or are not sure
        not to with another library of mathematics.
    """
    differs = np.empty((3, len(rows)), bool)
    points = np.empty((3, len(rows)), np.float32)
    with np.errstate(all='ignore'):
        for part in _row_parts(len(rows)):
            points[:, part] = _measured(rows[part, :3], twist)
            differs[:, part] = _differ(points[:, part], twist, file[part])
        other = np.flatnonzero(differs.any(axis=0))
        own = on_grid(measured(file[other, :3].astype(np.float64), twist)).T
        own = own + 0  # of -0.0, as _measured
        beside = np.rint((own - points[:, other]) * PER_METRE)
        solved = ~_differ(own, twist, file[other]).any(axis=0)
        solved &= np.abs(beside).max(axis=0, initial=0) <= _MOST_STEPS
    differs[:, other[solved]] = False
    steps = beside.T[solved].astype(np.int8)
    points_beside, axes = np.nonzero(steps)
    indices = other[solved][points_beside] * 3 + axes
    return GridSteps(indices.astype('<u4'), steps[points_beside, axes]), differs.T


def _differ(axes: Float32Array, twist: Float64Array, file: Float32Array) -> npt.NDArray[np.bool_]:
    """Return which coordinates of measured (3, N) points do not surely give the bits of a file."""
    exact = compensated_axes(axes.astype(np.float64), twist)
    own = np.ascontiguousarray(file[:, :3].T)
    differs: npt.NDArray[np.bool_] = (exact - _UNSURE_M).astype(np.float32) != own
    differs |= (exact + _UNSURE_M).astype(np.float32) != own
    return differs


def _measured(
    points: Float32Array, twist: Float64Array, beside: Float32Array | None = None
) -> Float32Array:
    """Return the (3, N) points of the grid that (N, 3) rounded compensated ones are made of.

    Args:
        points: Metres.
        twist: Of a turn.
        beside: (N, 3) steps to add.
    """
    axes = np.ascontiguousarray(points.T)
    steps = moves_back(axes, twist)
    steps *= PER_METRE
    axes *= PER_METRE
    for millimetres in (steps, axes):
        np.rint(millimetres, out=millimetres)
    axes += steps
    if beside is not None:
        axes += beside.T
    axes += 0  # of -0.0, which would be at the other end of the turn
    axes /= PER_METRE
    return axes


def _row_parts(count: int) -> Iterator[slice]:
    return (slice(first, first + _ROWS) for first in range(0, count, _ROWS))
