# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bird's-eye view: points, boxes with their headings, rings of equal distance, the legend."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..options.pictures import ColorBy
from .footprints import TEXT_SCALE, BirdView, draw_footprints, left_out
from .looks import bgr
from .palette import EGO_COLOR, EGO_SIZE_LWH
from .point_colors import PointColors
from .points import scatter
from .scales import DIM, SCALES
from .strokes import cut_segments, draw_segments, new_picture, sides_of, size_of
from .text import extent_of, fitted, put_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.samples import Float32Array
    from ..options.pictures import BirdOptions
    from .objects import LabelledObject
    from .pixels import Pixels

BACKGROUND = (24, 20, 18)
_RING_COLOR = (84, 76, 70)
_RING_TEXT = (186, 178, 172)
_RING_STEPS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_MOST_RINGS = 8
_LARGEST = 1 << 20
"""Greatest distance of a ring, pixels; OpenCV's fixed point overflows beyond."""

BY_HEIGHT = PointColors(ColorBy.HEIGHT)
_LEGEND_SCALE = 1.1
_LEGEND_WIDTH = 230
"""Of the colour bar at this scale, at least, pixels."""

_SHIFT = 4
EGO_MIDDLE_X = 0.59
"""The centre of KITTI's car ahead of its scanner, metres: 1.35 m ahead of the rear axle, which is
0.76 m behind the scanner."""


def birds_eye(
    points: Float32Array | None,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    options: BirdOptions,
    colors: PointColors = BY_HEIGHT,
    *,
    named: bool = True,
) -> Pixels:
    """Draw a bird's-eye view into a new (H, W, 3) picture.

    Args:
        points: (N, 4) x y z in velo_link, metres, and reflectance; None without a scan.
        objects: Ground truth; those without a 3D box are left out.
        predictions: Drawn in the style of predictions.
        options: Range and resolution.
        colors: The colours of points.
        named: Whether boxes have tags.
    """
    picture = new_picture(options.size, BACKGROUND)
    view = BirdView.of(options)
    radii = _ring_radii(options)
    _draw_rings(picture, view, radii)
    layer = None if points is None else draw_points_from_above(picture, points, view, colors)
    _label_rings(picture, view, radii)
    _draw_ego(picture, view)
    if layer is not None:
        colors.draw_legend(picture, layer, _LEGEND_SCALE, below=True)
    _draw_notes(picture, left_out(objects, predictions, view, size_of(picture)))
    draw_footprints(picture, objects, view, predictions, named=named)
    return picture


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_points_from_above(
    picture: Pixels, points: Float32Array, view: BirdView, colors: PointColors = BY_HEIGHT
) -> npt.NDArray[np.uint8]:
    """Draw points, the highest on top, and return their (H, W) shades."""
    width, height = size_of(picture)
    scale = np.float32(view.pixels_per_metre)
    columns = (np.float32(view.left_m) - points[:, 1]) * scale
    rows = (np.float32(view.top_m) - points[:, 0]) * scale
    inside = np.flatnonzero((columns >= 0) & (columns < width) & (rows >= 0) & (rows < height))
    heights = SCALES[ColorBy.HEIGHT].shades(points[inside, 2])
    order = np.argsort(heights, kind='stable')
    places = np.stack([columns[inside], rows[inside]], axis=1).astype(np.int32)
    shades = heights if colors.by is ColorBy.HEIGHT else colors.shades(points, inside)
    layer = scatter(places[order], shades[order], (width, height), 1)
    colors.paint(picture, layer)
    return layer


def _draw_notes(picture: Pixels, lines: Sequence[str]) -> None:
    """Write lines in the lower right corner, right of the legend, on a darkened strip."""
    extent, room = extent_of('0', TEXT_SCALE), picture.shape[1] - _LEGEND_WIDTH
    line, pad = extent.above + extent.below + 2, extent.above
    shown = [fitted(text, room - 3 * pad, TEXT_SCALE) for text in lines]
    width = max((extent_of(text, TEXT_SCALE).width for text in shown), default=0) + 2 * pad
    height = line * len(shown) + pad
    if not shown or width > room or height > picture.shape[0]:
        return
    strip = picture[-height - pad : -pad, -width - pad : -pad]
    strip[:] = cv2.convertScaleAbs(strip, alpha=DIM)
    for place, text in enumerate(shown):
        baseline = place * line + pad // 2 + extent.above + 1
        put_text(strip, text, (pad, baseline), TEXT_SCALE, _RING_TEXT)


def _ring_radii(options: BirdOptions) -> list[int]:
    """Return the radii of the rings in the view, metres."""
    reach = float(np.hypot(np.abs(options.x_range).max(), np.abs(options.y_range).max()))
    if reach * options.pixels_per_metre > _LARGEST:
        return []
    for step in _RING_STEPS_M:
        if reach / step <= _MOST_RINGS:
            return list(range(step, int(reach) + 1, step))
    return []


def _draw_rings(picture: Pixels, view: BirdView, radii: Sequence[int]) -> None:
    """Draw rings of equal distance from the scanner."""
    column, row = view.pixels(np.zeros(2)).tolist()
    centre = (round(column * (1 << _SHIFT)), round(row * (1 << _SHIFT)))
    for radius in radii:
        pixels = round(radius * view.pixels_per_metre * (1 << _SHIFT))
        cv2.circle(picture, centre, pixels, _RING_COLOR, 1, cv2.LINE_AA, _SHIFT)


def _label_rings(picture: Pixels, view: BirdView, radii: Sequence[int]) -> None:
    """Write each ring's radius straight ahead."""
    extent = extent_of('0', TEXT_SCALE)
    for radius in radii:
        label = f'{radius} m'
        column, row = view.pixels(np.array([radius, 0.0])).tolist()
        room = extent_of(label, TEXT_SCALE).width
        if extent.above <= row < picture.shape[0] and room <= column < picture.shape[1] - room:
            top = round(row - extent.above / 2)
            left = round(column - room / 2)
            window = picture[top - 2 : top + extent.above + 3, left - 3 : left + room + 3]
            window[:] = cv2.convertScaleAbs(window, alpha=0.3)
            put_text(picture, label, (left, top + extent.above), TEXT_SCALE, _RING_TEXT)


def _draw_ego(picture: Pixels, view: BirdView) -> None:
    """Draw the recording car and its heading."""
    length, width, _ = EGO_SIZE_LWH
    front, rear = EGO_MIDDLE_X + length / 2, EGO_MIDDLE_X - length / 2
    side = width / 2
    corners = np.array([(front, side), (front, -side), (rear, -side), (rear, side)])
    nose = np.array([(rear + 0.7 * length, side), (front, 0.0), (rear + 0.7 * length, -side)])
    wedge = view.pixels(nose)
    lines = np.concatenate(
        [sides_of(view.pixels(corners)), np.stack([wedge[:-1], wedge[1:]], axis=1)]
    )
    draw_segments(picture, cut_segments(lines, size_of(picture))[0], bgr(EGO_COLOR), 2)
