# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bird's-eye view: points by height, boxes with their headings, rings of equal distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..options.pictures import ColorBy, ColorMap
from .looks import bgr, box_color, corners_of, name_of, nearest_first
from .palette import EGO_COLOR, EGO_SIZE_LWH
from .points import scatter
from .scales import SCALES, colored
from .strokes import cut_segments, dashes, draw_segments, has_pixels, new_picture, sides_of, size_of
from .text import Tag, draw_tags, extent_of, put_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
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

_SHIFT = 4
_SMALL = 30.0
_TEXT_SCALE = 0.36
_ARROW_M = (0.5, 1.2)
"""Least and greatest length of an arrow outside of its box, metres."""
_EGO_MIDDLE_X = 0.59
"""The centre of KITTI's car ahead of its scanner, metres: 1.35 m ahead of the rear axle, which is
0.76 m behind the scanner."""


@dataclass(frozen=True)
class BirdView:
    """The mapping of velo_link to the pixels of a bird's-eye view.

    Attributes:
        left_m, top_m: y and x of the picture's upper left corner, metres.
        pixels_per_metre: Resolution.
    """

    left_m: float
    top_m: float
    pixels_per_metre: float

    @classmethod
    def of(cls, options: BirdOptions) -> BirdView:
        """Return the view of some options."""
        return cls(options.y_range[1], options.x_range[1], options.pixels_per_metre)

    def pixels(self, places: Float64Array) -> Float64Array:
        """Return (..., 2) column and row of (..., 2) x and y; pixel centres are whole numbers."""
        corner = np.array([self.left_m, self.top_m])
        found: Float64Array = (corner - places[..., ::-1]) * self.pixels_per_metre - 0.5
        return found


def birds_eye(
    points: Float32Array | None,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    options: BirdOptions,
    color_map: ColorMap = ColorMap.VIRIDIS,
    *,
    named: bool = True,
) -> Pixels:
    """Draw a bird's-eye view into a new (H, W, 3) picture.

    Args:
        points: (N, 4) x y z in velo_link, metres, and reflectance; None without a scan.
        objects: Ground truth; those without a 3D box are left out.
        predictions: Drawn in the style of predictions.
        options: Range and resolution.
        color_map: The colours of heights.
        named: Whether boxes have tags.
    """
    picture = new_picture(options.size, BACKGROUND)
    view = BirdView.of(options)
    radii = _ring_radii(options)
    _draw_rings(picture, view, radii)
    if points is not None:
        draw_points_from_above(picture, points, view, color_map)
    _label_rings(picture, view, radii)
    _draw_ego(picture, view)
    draw_footprints(picture, objects, view, predictions, named=named)
    return picture


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_points_from_above(
    picture: Pixels,
    points: Float32Array,
    view: BirdView,
    color_map: ColorMap = ColorMap.VIRIDIS,
    point_size: int = 1,
) -> None:
    """Draw points, the highest on top, coloured by height."""
    if not has_pixels(picture):
        return
    width, height = size_of(picture)
    scale = np.float32(view.pixels_per_metre)
    with np.errstate(over='ignore'):
        columns = (np.float32(view.left_m) - points[:, 1]) * scale
        rows = (np.float32(view.top_m) - points[:, 0]) * scale
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    shades = SCALES[ColorBy.HEIGHT].shades(points[inside, 2])
    order = np.argsort(shades, kind='stable')
    places = np.stack([columns[inside], rows[inside]], axis=1).astype(np.int32)
    layer = scatter(places[order], shades[order], (width, height), point_size)
    cv2.copyTo(colored(layer, color_map), layer, picture)


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_footprints(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    view: BirdView,
    predictions: Sequence[LabelledObject] = (),
    *,
    named: bool = True,
) -> None:
    """Draw the outline of each 3D box from above, an arrow along its heading, and its tag.

    Args:
        picture: (H, W, 3) uint8 BGR, drawn on in place.
        objects: Those without a 3D box are left out.
        view: Of the picture.
        predictions: Drawn in the style of predictions.
        named: Whether boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    if not has_pixels(picture):
        return
    shown = nearest_first(objects, predictions)
    corners = corners_of(shown)
    outlines = view.pixels(corners[:, :4, :2])
    size, tags = size_of(picture), []
    arrows = view.pixels(_arrows(corners))
    for place in reversed(range(len(shown))):
        (each, predicted), outline = shown[place], outlines[place]
        color = box_color(each, predicted=predicted)
        sides, _ = cut_segments(sides_of(outline), size)
        if not len(sides):
            continue
        width = 1 if predicted or np.ptp(outline, axis=0).max() < _SMALL else 2
        draw_segments(picture, dashes(sides, 0.7) if predicted else sides, color, width)
        draw_segments(picture, cut_segments(arrows[place], size)[0], color, width)
        seen = sides.reshape(-1, 2).clip(0, np.array(size) - 1.0)
        bounds = (*seen.min(axis=0).tolist(), *seen.max(axis=0).tolist())
        tags.append(Tag(name_of(each), bounds, color, outlined=predicted, beside=True))
    if named:
        draw_tags(picture, tags[::-1], _TEXT_SCALE)


def _arrows(corners: Float64Array) -> Float64Array:
    """Return (N, 3, 2, 2) shaft and barbs of an arrow in x and y for each of (N, 8, 3) boxes."""
    middle = corners[:, :4, :2].mean(axis=1)
    front = corners[:, :2, :2].mean(axis=1)
    with np.errstate(invalid='ignore', divide='ignore'):
        ahead = (front - middle) / np.linalg.norm(front - middle, axis=1, keepdims=True)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    reach = np.clip(np.linalg.norm(front - middle, axis=1, keepdims=True), *_ARROW_M)
    tip = front + reach * ahead
    barbs = [tip - reach * (0.5 * ahead + 0.35 * sign * aside) for sign in (1, -1)]
    return np.stack([np.stack([start, tip], axis=1) for start in (middle, *barbs)], axis=1)


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
    extent = extent_of('0', _TEXT_SCALE)
    for radius in radii:
        label = f'{radius} m'
        column, row = view.pixels(np.array([radius, 0.0])).tolist()
        room = extent_of(label, _TEXT_SCALE).width
        if extent.above <= row < picture.shape[0] and room <= column < picture.shape[1] - room:
            top = round(row - extent.above / 2)
            left = round(column - room / 2)
            window = picture[top - 2 : top + extent.above + 3, left - 3 : left + room + 3]
            window[:] = cv2.convertScaleAbs(window, alpha=0.3)
            put_text(picture, label, (left, top + extent.above), _TEXT_SCALE, _RING_TEXT)


def _draw_ego(picture: Pixels, view: BirdView) -> None:
    """Draw the recording car and its heading."""
    length, width, _ = EGO_SIZE_LWH
    front, rear = _EGO_MIDDLE_X + length / 2, _EGO_MIDDLE_X - length / 2
    side = width / 2
    corners = np.array([(front, side), (front, -side), (rear, -side), (rear, side)])
    nose = np.array([(rear + 0.7 * length, side), (front, 0.0), (rear + 0.7 * length, -side)])
    wedge = view.pixels(nose)
    lines = np.concatenate(
        [sides_of(view.pixels(corners)), np.stack([wedge[:-1], wedge[1:]], axis=1)]
    )
    draw_segments(picture, cut_segments(lines, size_of(picture))[0], bgr(EGO_COLOR), 2)
