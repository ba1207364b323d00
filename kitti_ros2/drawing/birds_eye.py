# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bird's-eye view: points by height, boxes with their headings, rings of equal distance."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..model.boxes import DONT_CARE
from ..options.pictures import ColorBy
from .looks import bgr, box_color, corners_of, name_of, nearest_first
from .palette import EGO_COLOR, EGO_SIZE_LWH
from .point_colors import PointColors
from .points import scatter
from .scales import DIM, SCALES
from .strokes import cut_segments, dashes, draw_segments, has_pixels, new_picture, sides_of, size_of
from .text import Tag, draw_tags, extent_of, fitted, put_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from ..options.pictures import BirdOptions
    from .objects import LabelledObject
    from .pixels import Pixels
    from .strokes import Bounds

BACKGROUND = (24, 20, 18)
_RING_COLOR = (84, 76, 70)
_RING_TEXT = (186, 178, 172)
_RING_STEPS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_MOST_RINGS = 8
_LARGEST = 1 << 20
"""Greatest distance of a ring, pixels; OpenCV's fixed point overflows beyond."""

BY_HEIGHT = PointColors(ColorBy.HEIGHT)
_LEGEND_SCALE = 0.9
_LEGEND_WIDTH = 180
"""Of the colour bar at this scale, at least, pixels."""

_SHIFT = 4
_SMALL = 30.0
_TEXT_SCALE = 0.36
_ARROW_M = (0.5, 1.2)
"""Least and greatest length of an arrow outside of its box, metres."""
EGO_MIDDLE_X = 0.59
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
    if points is not None:
        layer = draw_points_from_above(picture, points, view, colors)
    _label_rings(picture, view, radii)
    _draw_ego(picture, view)
    if points is not None:
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
        bounds = _bounds(outline, size)
        if bounds is None:
            continue
        sides, _ = cut_segments(sides_of(outline), size)
        width = 1 if predicted or np.ptp(outline, axis=0).max() < _SMALL else 2
        draw_segments(picture, dashes(sides, 0.7) if predicted else sides, color, width)
        draw_segments(picture, cut_segments(arrows[place], size)[0], color, width)
        tags.append(Tag(name_of(each), bounds, color, outlined=predicted, beside=True))
    if named:
        draw_tags(picture, tags[::-1], _TEXT_SCALE)


def _bounds(outline: Float64Array, size: tuple[int, int]) -> Bounds | None:
    """Return the bounds within a picture of a (4, 2) outline, None for one out of range."""
    sides, _ = cut_segments(sides_of(outline), size)
    if not len(sides):
        return None
    seen = sides.reshape(-1, 2).clip(0, np.array(size) - 1.0)
    (left, top), (right, bottom) = seen.min(axis=0).tolist(), seen.max(axis=0).tolist()
    return (left, top, right, bottom) if right > left and bottom > top else None


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def left_out(
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    view: BirdView,
    size: tuple[int, int],
) -> list[str]:
    """Return one line for each reason why objects are not in a view: their classes and number."""
    lines = []
    for title, shown in (('', objects), ('predictions ', predictions)):
        outlines = view.pixels(corners_of([(each, False) for each in shown])[:, :4, :2])
        out: Counter[str] = Counter()
        flat: Counter[str] = Counter()
        for each, outline in zip(shown, outlines, strict=True):
            if each.cuboid is None:
                flat[each.kind] += each.kind != DONT_CARE
            elif _bounds(outline, size) is None:
                out[each.kind] += 1
        for reason, counts in (('out of range', out), ('without a 3D box', flat)):
            if +counts:
                kinds = (f'{count} {kind}' for kind, count in (+counts).most_common())
                lines.append(f'{title}{reason}: {", ".join(kinds)}')
    return lines


def _draw_notes(picture: Pixels, lines: Sequence[str]) -> None:
    """Write lines in the lower right corner, right of the legend, on a darkened strip."""
    extent, room = extent_of('0', _TEXT_SCALE), picture.shape[1] - _LEGEND_WIDTH
    line, pad = extent.above + extent.below + 2, extent.above
    shown = [fitted(text, room - 3 * pad, _TEXT_SCALE) for text in lines]
    width = max((extent_of(text, _TEXT_SCALE).width for text in shown), default=0) + 2 * pad
    height = line * len(shown) + pad
    if not shown or width > room or height > picture.shape[0]:
        return
    strip = picture[-height - pad : -pad, -width - pad : -pad]
    strip[:] = cv2.convertScaleAbs(strip, alpha=DIM)
    for place, text in enumerate(shown):
        baseline = place * line + pad // 2 + extent.above + 1
        put_text(strip, text, (pad, baseline), _TEXT_SCALE, _RING_TEXT)


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
    front, rear = EGO_MIDDLE_X + length / 2, EGO_MIDDLE_X - length / 2
    side = width / 2
    corners = np.array([(front, side), (front, -side), (rear, -side), (rear, side)])
    nose = np.array([(rear + 0.7 * length, side), (front, 0.0), (rear + 0.7 * length, -side)])
    wedge = view.pixels(nose)
    lines = np.concatenate(
        [sides_of(view.pixels(corners)), np.stack([wedge[:-1], wedge[1:]], axis=1)]
    )
    draw_segments(picture, cut_segments(lines, size_of(picture))[0], bgr(EGO_COLOR), 2)
