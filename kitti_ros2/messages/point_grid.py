# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Organised clouds: a row for each laser, the highest first, and columns of time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from .point_values import PointValues

COLUMNS = 2176
"""Columns of a grid: the most returns of a laser in KITTI's samples are 2165, and 17 * 128 fits."""


def organise(cloud: npt.NDArray[np.void], values: PointValues) -> npt.NDArray[np.void]:
    """Return points as a grid (rows, columns), with each point in a cell of its own.

    Missing returns are NaN for x y z, with the ring of their row and the time of their column.
    """
    cells, columns = place(values.row, values.part, values.rows)
    grid = np.zeros((values.rows, columns), dtype=cloud.dtype)
    for name in 'xyz':
        grid[name] = np.nan
    grid['ring'] = np.arange(values.rows)[:, None]
    grid['t'] = values.nanoseconds_of((np.arange(columns) + 0.5) / columns)
    grid.reshape(-1).view(f'V{cloud.itemsize}')[cells] = cloud.view(f'V{cloud.itemsize}')
    return grid


def place(
    rows: npt.NDArray[np.uint16], parts: Float64Array, row_count: int
) -> tuple[npt.NDArray[np.intp], int]:
    """Return the cell of each point in a grid, row by row, (N,), and the number of columns.

    The column is that of the point's part of the turn, or the next free one: within a row, columns
    rise with time. There are more than COLUMNS if a row has more points.
    """
    order = np.argsort(rows + parts / 2, kind='stable')
    row = rows[order].astype(np.intp)
    counts = np.bincount(row, minlength=row_count)
    columns = max(COLUMNS, int(counts.max(initial=0)))
    place_in_row = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
    wanted = np.minimum((parts[order] * columns).astype(np.intp), columns - 1)
    # Columns minus places must not fall within a row; rows are kept apart by an offset.
    apart = row * (2 * columns)
    free = np.maximum.accumulate(wanted - place_in_row + apart) - apart + place_in_row
    cells = np.empty(len(row), dtype=np.intp)
    cells[order] = row * columns + np.minimum(free, columns - counts[row] + place_in_row)
    return cells, columns
