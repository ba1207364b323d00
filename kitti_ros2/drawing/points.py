# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of a scan's points on a camera image, the nearest on top."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .looks import scale_of
from .point_colors import PointColors
from .scales import EMPTY
from .strokes import has_pixels, size_of

if TYPE_CHECKING:
    from ..model.samples import Float32Array
    from .pixels import Pixels
    from .projection import Projection


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_points(
    picture: Pixels,
    points: Float32Array,
    projection: Projection,
    colors: PointColors = PointColors(),  # noqa: B008 - immutable
    point_size: int = 2,
) -> None:
    """Draw the points that the camera sees, and the legend of their colours.

    Args:
        picture: (H, W, 3) uint8 BGR, drawn on in place.
        points: (N, 4) x y z in velo_link, metres, and reflectance 0..1.
        projection: Into the picture.
        colors: The colours of points.
        point_size: Diameter of a point, pixels.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    if not has_pixels(picture):
        return
    size = size_of(picture)
    pixels, depth, chosen = seen_points(points, projection, size)
    order = np.argsort(-depth)
    shades = colors.shades(points, chosen[order], depth[order])
    layer = scatter(pixels[order], shades, size, point_size)
    colors.paint(picture, layer)
    colors.draw_legend(picture, layer, scale_of(picture))


def seen_points(
    points: Float32Array, projection: Projection, size: tuple[int, int]
) -> tuple[npt.NDArray[np.int32], Float32Array, npt.NDArray[np.intp]]:
    """Return the points visible in an image.

    Returns:
        (K, 2) int32 column and row, (K,) depth in metres, and the (K,) indices of the points.
    """
    seen = projection.homogeneous(points[:, :3])
    ahead = np.flatnonzero(seen[:, 2] > 0)
    pixels = projection.pixels(seen[ahead])
    u, v = pixels.T
    inside = (u >= -0.5) & (u < size[0] - 0.5) & (v >= -0.5) & (v < size[1] - 0.5)
    chosen = ahead[inside]
    places = np.rint(pixels[inside]).astype(np.int32)
    return places, seen[chosen, 2].astype(np.float32), chosen


def scatter(
    pixels: npt.NDArray[np.int32],
    shades: npt.NDArray[np.uint8],
    size: tuple[int, int],
    point_size: int,
) -> npt.NDArray[np.uint8]:
    """Return (H, W) shades of points, each a disc; later ones cover earlier ones.

    Args:
        pixels: (N, 2) column and row, within the image.
        shades: (N,).
        size: (width, height).
        point_size: Diameter, pixels.
    """
    width, height = size
    # A border as wide as the discs replaces a test of each of their pixels.
    offsets = _disc(point_size)
    border = int(np.abs(offsets).max())
    layer = np.full((height + 2 * border, width + 2 * border), EMPTY, np.uint8)
    middles = (pixels[:, 1] + border) * layer.shape[1] + pixels[:, 0] + border
    steps = offsets[:, 1] * layer.shape[1] + offsets[:, 0]
    # NumPy assigns in order, so of several points on one pixel the last stays.
    layer.reshape(-1)[(middles[:, None] + steps).ravel()] = np.repeat(shades, len(steps))
    return np.ascontiguousarray(layer[border : border + height, border : border + width])


def _disc(diameter: int) -> npt.NDArray[np.int32]:
    """Return (K, 2) offsets of a disc's pixels from its central pixel."""
    reach = np.arange(diameter) - (diameter - 1) // 2
    x, y = (each.ravel() for each in np.meshgrid(reach, reach))
    middle = 0.5 if diameter % 2 == 0 else 0.0
    inside = (x - middle) ** 2 + (y - middle) ** 2 <= (diameter / 2) ** 2 + 0.25
    return np.stack([x[inside], y[inside]], axis=1).astype(np.int32)
