# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Views from above: the bird's-eye view, the perspective from behind the car, the route."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from ..model.boxes import DONT_CARE, EDGES, Cuboid, cuboid_corners
from ..model.geometry import Transform
from ..options.outputs import ColorBy
from .annotate import draw_wireframes
from .labelled_objects import EGO_COLOR, EGO_SIZE_LWH, name_of
from .points import DIM, SCALES, PointColors, scatter, seen_points
from .primitives import (
    Tag,
    bgr,
    box_color,
    corners_of,
    cut_segments,
    dashes,
    draw_segments,
    draw_tags,
    extent_of,
    fitted,
    has_pixels,
    is_quiet,
    new_picture,
    objects_to_draw,
    put_text,
    scale_of,
    sides_of,
    size_of,
    slices_of,
)
from .projection import Projection

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from ..options.outputs import BirdOptions
    from .labelled_objects import LabelledObject, Pixels
    from .primitives import Color


# Boxes from above: outlines with their headings, and objects out of range.

TEXT_SCALE = 0.36
_SMALL = 30.0
_ARROW_M = (0.5, 1.2)
"""Least and greatest length of an arrow outside of its box, metres."""
_ARROW_LINES = 3


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

    def pixels(self, positions: Float64Array) -> Float64Array:
        """Return (..., 2) column and row of (..., 2) x and y; pixel centres are whole numbers."""
        corner = np.array([self.left_m, self.top_m])
        pixels: Float64Array = (corner - positions[..., ::-1]) * self.pixels_per_metre - 0.5
        return pixels


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
        objects: Labels; objects without a 3D box are left out.
        view: View of the picture.
        predictions: Drawn in the style of predictions.
        named: True if boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    shown = objects_to_draw(picture, objects, predictions)
    corners = corners_of(shown)
    outlines = view.pixels(corners[:, :4, :2])
    size, tags = size_of(picture), []
    seen = _Sides.of(outlines, size)
    sides_at = slices_of(seen.owners, len(shown))
    arrows, origins = cut_segments(view.pixels(_arrows(corners)).reshape(-1, 2, 2), size)
    arrows_at = slices_of(origins // _ARROW_LINES, len(shown))
    for index in reversed(range(len(shown))):
        (obj, predicted), outline = shown[index], outlines[index]
        color = box_color(obj, predicted=predicted)
        if np.isnan(seen.bounds[index, 0]):
            continue
        sides = seen.parts[sides_at[index]]
        small = np.ptp(outline, axis=0).max() < _SMALL
        width = 1 if predicted or small or is_quiet(obj) else 2
        draw_segments(picture, dashes(sides, 0.7) if predicted else sides, color, width)
        draw_segments(picture, arrows[arrows_at[index]], color, width)
        left, top, right, bottom = seen.bounds[index].tolist()
        bounds = (left, top, right, bottom)
        tags.append(Tag(name_of(obj), bounds, color, outlined=predicted, beside=True))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE)


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def describe_omitted(
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    view: BirdView,
    size: tuple[int, int],
) -> list[str]:
    """Describe objects that are not in a view, one line for each reason."""
    lines = []
    for title, shown in (('', objects), ('predictions ', predictions)):
        if not shown:
            continue
        outlines = view.pixels(corners_of([(obj, False) for obj in shown])[:, :4, :2])
        bounds = _Sides.of(outlines, size).bounds
        out: Counter[str] = Counter()
        flat: Counter[str] = Counter()
        for obj, seen in zip(shown, ~np.isnan(bounds[:, 0]), strict=True):
            if obj.cuboid is None:
                flat[obj.class_name] += obj.class_name != DONT_CARE
            elif not seen:
                out[obj.class_name] += 1
        for reason, counts in (('out of range', out), ('without a 3D box', flat)):
            if +counts:
                classes = (f'{count} {class_name}' for class_name, count in (+counts).most_common())
                lines.append(f'{title}{reason}: {", ".join(classes)}')
    return lines


class _Sides(NamedTuple):
    """The parts of outlines within a picture.

    Attributes:
        parts: (K, 2, 2) lines in pixels.
        owners: (K,) the outline of each, ascending.
        bounds: (N, 4) left, top, right, bottom of each outline; NaN for one out of range.
    """

    parts: Float64Array
    owners: npt.NDArray[np.intp]
    bounds: Float64Array

    @classmethod
    def of(cls, outlines: Float64Array, size: tuple[int, int]) -> _Sides:
        """Clip (N, 4, 2) outlines in pixels to a picture of a (width, height)."""
        parts, lines = cut_segments(sides_of(outlines).reshape(-1, 2, 2), size)
        owners = lines // 4
        bounds = np.full((len(outlines), 4), np.nan)
        in_view, first = np.unique(owners, return_index=True)
        if len(in_view):
            seen = parts.clip(0, np.array(size) - 1.0)
            bounds[in_view, :2] = np.minimum.reduceat(seen.min(axis=1), first)
            bounds[in_view, 2:] = np.maximum.reduceat(seen.max(axis=1), first)
        bounds[~(bounds[:, 2:] > bounds[:, :2]).all(axis=1)] = np.nan
        return cls(parts, owners, bounds)


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


# Bird's-eye view: points, boxes with their headings, rings of equal distance, the legend.

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
"""Least width of the colour bar at this scale, pixels."""

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
        named: True if boxes have tags.
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
    _draw_notes(picture, describe_omitted(objects, predictions, view, size_of(picture)))
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
    pixels = np.stack([columns[inside], rows[inside]], axis=1).astype(np.int32)
    shades = heights if colors.by is ColorBy.HEIGHT else colors.shades(points, inside)
    layer = scatter(pixels[order], shades[order], (width, height), 1)
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
    for row, text in enumerate(shown):
        baseline = row * line + pad // 2 + extent.above + 1
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


# A scan and its boxes in perspective, from above and behind the car, with a grid on the ground.

SIZE = (1280, 720)
"""(width, height), pixels."""

_EYE = np.array([-13.0, 4.0, 9.0])
_TARGET = np.array([14.0, 0.0, -1.5])
_VIEW_ANGLE = math.radians(70.0)
"""Horizontal."""

_GROUND_Z = -1.73
"""Height of KITTI's road relative to its scanner, metres."""

_GRID_X, _GRID_Y, _GRID_STEP = (-20, 80), (-40, 40), 10
_LABELS = (10, 20, 30, 40, 60, 80)
_GRID_COLOR = (66, 60, 55)
_GRID_TEXT = (186, 178, 172)
_TEXT_SCALE = 0.4


def view_from_behind(size: tuple[int, int] = SIZE) -> Projection:
    """Return the projection of velo_link to a picture of a (width, height)."""
    forward = (_TARGET - _EYE) / np.linalg.norm(_TARGET - _EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    focal = size[0] / 2 / math.tan(_VIEW_ANGLE / 2)
    k = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    return Projection(k @ np.column_stack([rotation, -rotation @ _EYE]))


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_perspective(
    points: Float32Array | None,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    colors: PointColors = BY_HEIGHT,
    point_size: int = 2,
    *,
    named: bool = True,
    size: tuple[int, int] = SIZE,
) -> Pixels:
    """Draw a scan and boxes in perspective into a new picture.

    Args:
        points: (N, 4) x y z in velo_link, metres, and reflectance; None without a scan.
        objects: Ground truth; those without a 3D box are left out.
        predictions: Drawn in the style of predictions.
        colors: The colours of points; depth is the distance from the scanner.
        point_size: Diameter of a point, pixels.
        named: True if boxes have tags.
        size: (width, height), pixels; below half the width of SIZE nothing is written.
    """
    picture = new_picture(size, BACKGROUND)
    projection = view_from_behind(size)
    _draw_grid(picture, projection)
    layer = None
    if points is not None:
        pixels, depth, chosen = seen_points(points, projection, size)
        order = np.argsort(-depth)  # a nearer point covers those behind it
        shades = colors.shades(points, chosen[order])
        layer = scatter(pixels[order], shades, size, point_size)
        colors.paint(picture, layer)
    legible = size[0] >= SIZE[0] // 2
    if legible:
        _label_grid(picture, projection)
    _draw_car(picture, projection)
    draw_wireframes(picture, objects, projection, predictions, named=named)
    if layer is not None and legible:
        colors.draw_legend(picture, layer, scale_of(picture))
    return picture


def _draw_grid(picture: Pixels, projection: Projection) -> None:
    """Draw lines on the ground, 10 m apart."""
    xs = np.arange(_GRID_X[0], _GRID_X[1] + 1, _GRID_STEP)
    ys = np.arange(_GRID_Y[0], _GRID_Y[1] + 1, _GRID_STEP)
    across = [[(x, ys[0], _GROUND_Z), (x, ys[-1], _GROUND_Z)] for x in xs]
    along = [[(xs[0], y, _GROUND_Z), (xs[-1], y, _GROUND_Z)] for y in ys]
    _draw_lines(picture, projection, np.array(across + along, np.float64), _GRID_COLOR, 1)


def _label_grid(picture: Pixels, projection: Projection) -> None:
    """Write the distance of lines ahead of the scanner, halfway to their right end."""
    scale = _TEXT_SCALE * scale_of(picture)
    for x in _LABELS:
        label = f'{x} m'
        middle = projection.pixels(projection.homogeneous((x, _GRID_Y[0] / 2, _GROUND_Z)))
        left = middle[0] - extent_of(label, scale).width / 2
        put_text(picture, label, (left, middle[1] - 2), scale, _GRID_TEXT)


def _draw_car(picture: Pixels, projection: Projection) -> None:
    """Draw the edges of the recording car."""
    middle = np.array([EGO_MIDDLE_X, 0.0, _GROUND_Z + EGO_SIZE_LWH[2] / 2])
    car = Cuboid('', '', Transform(np.eye(3), middle), EGO_SIZE_LWH)
    _draw_lines(picture, projection, cuboid_corners([car])[0, EDGES], bgr(EGO_COLOR), 2)


def _draw_lines(
    picture: Pixels,
    projection: Projection,
    ends: Float64Array,
    color: tuple[int, int, int],
    width: int,
) -> None:
    """Draw (M, 2, 3) lines in velo_link."""
    segments, _ = projection.segments(ends)
    draw_segments(picture, cut_segments(segments, size_of(picture))[0], color, width)


# The path of the car from above, on axes of equal scale.

_MARGIN = 40
_LEAST_M = 10.0
"""The plot is at least this wide, so that a parked car does not look like a moving one."""

_FARTHEST_M = 1e8
_LINE: Color = (205, 200, 196)
_TEXT: Color = (186, 178, 172)
_BAR_TEXT_SCALE = 0.45
_MOST_LINES = 4000


@np.errstate(all='ignore')  # poses may hold any numbers
def draw_route(window: Pixels, positions: Float64Array) -> None:
    """Draw a path with its start, its end, its length, and a bar for the scale.

    Args:
        window: (H, W, 3) uint8 BGR, drawn on in place.
        positions: (N, 3) in map, metres: x to the right, y up; those that are not on
            earth, such as NaN, are left out.
    """
    positions = positions[(np.abs(positions) < _FARTHEST_M).all(axis=1)]
    if not has_pixels(window) or not len(positions):
        return
    size = np.array(size_of(window))
    low, high = positions[:, :2].min(axis=0), positions[:, :2].max(axis=0)
    room = np.maximum(size - 2 * _MARGIN, 1)
    scale = float((room / np.maximum(high - low, _LEAST_M)).min())
    pixels = (positions[:, :2] - (low + high) / 2) * (scale, -scale) + size / 2
    thinned = pixels[:: len(pixels) // _MOST_LINES + 1]
    path = np.concatenate([thinned, pixels[-1:]])
    lines, _ = cut_segments(np.stack([path[:-1], path[1:]], axis=1), size_of(window))
    draw_segments(window, lines, _LINE, 2)
    for middle, radius, thickness in ((pixels[0], 4, 1), (pixels[-1], 6, cv2.FILLED)):
        column, row = np.rint(middle).astype(int).tolist()
        cv2.circle(window, (column, row), radius, bgr(EGO_COLOR), thickness, cv2.LINE_AA)
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    _draw_scale(window, scale, f'{length:.0f} m driven')


def _draw_scale(window: Pixels, scale: float, text: str) -> None:
    """Draw a bar of a round length in the lower left corner, and a text in the lower right one.

    Args:
        window: Drawn on in place.
        scale: Pixels per metre.
        text: One line.
    """
    width, height = size_of(window)
    most = width / 4 / scale
    power = 10.0 ** np.floor(np.log10(most))
    metres = max(step * power for step in (1, 2, 5) if step * power <= most)
    left, bottom = _MARGIN // 2, height - _MARGIN // 2
    cv2.line(window, (left, bottom), (left + round(metres * scale), bottom), _TEXT, 2)
    put_text(window, f'{metres:g} m', (left, bottom - 6), _BAR_TEXT_SCALE, _TEXT)
    right = width - left - extent_of(text, _BAR_TEXT_SCALE).width
    put_text(window, text, (right, bottom), _BAR_TEXT_SCALE, _TEXT)
