# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a scan that filters keep.

The lasers are counted on the whole scan. Each point must then pass every other filter: view, boxes,
range and height. Of the points left, each voxel keeps the first one in the file. Points without
finite coordinates pass no filter. The order of the points never changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..options.crop import LASERS

if TYPE_CHECKING:
    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from ..options.crop import CropOptions
    from .camera_view import CameraView

    Mask = npt.NDArray[np.bool_]


def kept_points(points: Float32Array, options: CropOptions, view: CameraView | None) -> Mask:
    """Return (N,) whether the filters keep each of (N, 4) points.

    Args:
        points: A whole scan: x y z in metres in velo_link, reflectance.
        options: The filters.
        view: The camera of this scan, if the options have a view.

    Raises:
        ValueError: Lasers cannot be counted; the message contains the reason.
    """
    keep = np.ones(len(points), bool)
    if not options.cuts or not len(points):
        return keep
    places = points[:, :3].astype(np.float64)
    keep &= _every_axis(np.isfinite(places))
    places[~keep] = 0.0
    if options.lasers is not None:
        keep[keep] = _every_nth_laser(points[keep], options.lasers)
    if view is not None:
        keep &= view.sees(points, places)
    if options.boxes:
        keep &= _in_any_box(places, options.boxes)
    if options.range_m is not None:
        x, y, z = places.T
        keep &= _between(np.sqrt(x * x + y * y + z * z), options.range_m)
    if options.height_m is not None:
        keep &= _between(places[:, 2], options.height_m)
    if options.voxel_m is not None:
        keep[keep] = first_of_each_voxel(places[keep], options.voxel_m)
    return keep


def first_of_each_voxel(places: Float64Array, size_m: float) -> Mask:
    """Return (N,) whether a point is the first of its voxel, a cube of a grid at the origin."""
    cells = np.floor(places / size_m)
    order = np.lexsort(cells.T)  # stable: the points of a voxel stay in their order
    ordered = cells[order]
    first = np.ones(len(places), bool)
    first[1:] = ~_every_axis(ordered[1:] == ordered[:-1])
    keep = np.zeros(len(places), bool)
    keep[order[first]] = True
    return keep


def _every_nth_laser(points: Float32Array, lasers: int) -> Mask:
    """Return whether a point is of the lowest laser or of every n-th above it."""
    from ..messages.point_values import rings  # noqa: PLC0415 - the messages of ROS

    if not len(points):
        return np.ones(0, bool)
    laser = rings(points)
    found = int(laser.max()) + 1
    if found not in {LASERS, lasers}:
        raise ValueError(
            f'the azimuth wraps {found - 1} times, so {found} lasers are found instead of {LASERS};'
            f' lasers can be counted only in whole scans in their original order'
        )
    every: Mask = laser % (found // lasers) == 0
    return every


def _in_any_box(places: Float64Array, boxes: tuple[tuple[float, ...], ...]) -> Mask:
    found = np.zeros(len(places), bool)
    for box in boxes:
        found |= _every_axis((places >= box[:3]) & (places <= box[3:]))
    return found


def _every_axis(rows: Mask) -> Mask:
    """Return whether all three of (N, 3) are true; eight times as fast as all(axis=1)."""
    every: Mask = rows[:, 0] & rows[:, 1] & rows[:, 2]
    return every


def _between(values: Float64Array, span: tuple[float, float]) -> Mask:
    inside: Mask = (values >= span[0]) & (values <= span[1])
    return inside
