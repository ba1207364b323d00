# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The points of a scan: colours by scales or classes, on images, and as range images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ..options.outputs import ColorBy, ColorMap
from .labelled_objects import semantic_names, semantic_shades, semantic_table
from .primitives import WHITE, extent_of, has_pixels, put_text, scale_of, size_of

if TYPE_CHECKING:
    from ..model.samples import Float32Array
    from .labelled_objects import Pixels
    from .projection import Projection


# Colour scales: values to shades, shades to colours, and the colour bar.

EMPTY = 0
"""The shade of a pixel without a value."""

_MAPS = {
    ColorMap.VIRIDIS: cv2.COLORMAP_VIRIDIS,
    ColorMap.PLASMA: cv2.COLORMAP_PLASMA,
    ColorMap.INFERNO: cv2.COLORMAP_INFERNO,
    ColorMap.MAGMA: cv2.COLORMAP_MAGMA,
    ColorMap.CIVIDIS: cv2.COLORMAP_CIVIDIS,
    ColorMap.TURBO: cv2.COLORMAP_TURBO,
    ColorMap.JET: cv2.COLORMAP_JET,
}


_ENDS = (40, 255)
DIM = 0.35
"""The brightness that remains below a legend."""

_RAMP_SIZE = (120, 8)
_RAMP_TEXT = 0.38


@dataclass(frozen=True)
class Scale:
    """A range of values represented by shades.

    Attributes:
        low, high: The values of the first and the last shade; values beyond are clipped.
        ticks: Values with a label.
        title: The quantity and its unit.
        logarithmic: True if equal ratios of values are equal steps of shade; else differences.
        reverse: True if the colour map runs from the high value to the low one.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    title: str
    logarithmic: bool = False
    reverse: bool = False

    def shares(self, values: npt.NDArray[np.floating]) -> Float32Array:
        """Return the position of values between low and high, 0..1; NaN counts as low."""
        low, high = np.float32(self.low), np.float32(self.high)
        bounded = np.clip(np.nan_to_num(values, nan=self.low), low, high).astype(np.float32)
        if self.logarithmic:
            bounded, low, high = np.log(bounded), np.log(low), np.log(high)
        shares: Float32Array = (bounded - low) / (high - low)
        return 1 - shares if self.reverse else shares

    def shades(self, values: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
        """Return shades 1..255 of values; 0 is EMPTY."""
        shades = self.shares(values) * np.float32(254) + np.float32(1.5)
        return np.asarray(shades, np.uint8)


SCALES = {
    # Near points have the detail, so steps of depth are ratios, and near is bright.
    ColorBy.DEPTH: Scale(
        4.0, 60.0, (5.0, 10.0, 20.0, 40.0), 'depth, m', logarithmic=True, reverse=True
    ),
    # Heights in velo_link: KITTI's road is at -1.73 m.
    ColorBy.HEIGHT: Scale(-2.5, 1.5, (-2.0, -1.0, 0.0, 1.0), 'height, m'),
    ColorBy.INTENSITY: Scale(0.0, 0.8, (0.0, 0.2, 0.4, 0.6, 0.8), 'intensity'),
}


@lru_cache(maxsize=len(_MAPS))
def color_table(color_map: ColorMap) -> Pixels:
    """Return (256, 1, 3) BGR of the shades."""
    # The low ends of the maps are dark, which is hardly visible on a dark background.
    ramp = np.linspace(*_ENDS, 255).round().astype(np.uint8)
    shades = np.concatenate([ramp[:1], ramp])[:, None]
    table = np.asarray(cv2.applyColorMap(shades, _MAPS[color_map]), np.uint8)
    table.flags.writeable = False
    return table


def colored(shades: npt.NDArray[np.uint8], table: Pixels) -> Pixels:
    """Return (H, W, 3) BGR of (H, W) shades, by a (256, 1, 3) table."""
    return np.asarray(cv2.applyColorMap(shades, table), np.uint8)


def draw_bar(
    picture: Pixels,
    scale: Scale,
    color_map: ColorMap,
    corner: tuple[int, int],
    size: tuple[int, int],
) -> None:
    """Draw a horizontal colour bar with its title above and its labels below, on a darkened strip.

    Args:
        picture: Drawn on in place; nothing is drawn if it is too small.
        scale: The values of the colours.
        color_map: The colours.
        corner: (x, y) of the strip's top left pixel.
        size: (width, height) of the bar itself, pixels.
    """
    width, height = size
    text_scale = height / 18
    extent = extent_of('0', text_scale)
    line, pad = extent.above + extent.below, extent_of('000', text_scale).width
    strip = picture[
        corner[1] : corner[1] + 2 * line + height + 2, corner[0] : corner[0] + width + 2 * pad
    ]
    if strip.shape[:2] != (2 * line + height + 2, width + 2 * pad):
        return
    strip[:] = cv2.convertScaleAbs(strip, alpha=DIM)
    put_text(strip, scale.title, (pad, extent.above + 1), text_scale)
    strip[line : line + height, pad : pad + width] = _ramp(scale, color_map, width)
    for tick, share in zip(scale.ticks, scale.shares(np.array(scale.ticks)), strict=True):
        x = pad + round(float(1 - share if scale.reverse else share) * (width - 1))
        room = extent_of(f'{tick:g}', text_scale).width
        cv2.line(strip, (x, line + height), (x, line + height + 1), WHITE, 1)
        baseline = line + height + 2 + extent.above
        put_text(strip, f'{tick:g}', (x - room / 2, baseline), text_scale)


def draw_ramp(picture: Pixels, scale: Scale, color_map: ColorMap, end: tuple[int, int]) -> None:
    """Draw a colour bar in one line of text: the low value, the colours, the high value.

    Args:
        picture: Drawn on in place.
        scale: The values of the colours.
        color_map: The colours.
        end: (x, y) of the end of the line, on the baseline.
    """
    (width, height), (right, baseline) = _RAMP_SIZE, end
    low, high = f'{scale.low:g}', f'{scale.high:g}'
    right -= extent_of(high, _RAMP_TEXT).width
    put_text(picture, high, (right, baseline), _RAMP_TEXT)
    left = right - height - width
    picture[baseline - height : baseline, left : left + width] = _ramp(scale, color_map, width)
    left -= height + extent_of(low, _RAMP_TEXT).width
    put_text(picture, low, (left, baseline), _RAMP_TEXT)


def _ramp(scale: Scale, color_map: ColorMap, width: int) -> Pixels:
    """Return (1, width, 3) colours from the low value to the high one."""
    values = np.linspace(1, 0, width) if scale.reverse else np.linspace(0, 1, width)
    return colored((values * 254 + 1.5).astype(np.uint8)[None], color_table(color_map))


# The colours of a scan's points, by a quantity or by class, with their legend.

_BAR_SIZE = (150, 7)
_TEXT_SCALE = 0.38


class PointColors(NamedTuple):
    """The colouring of a scan's points.

    Attributes:
        by: The quantity shown.
        color_map: Its colours; classes have their own.
        labels: (N,) SemanticKITTI labels of the scan, required to show classes.
    """

    by: ColorBy = ColorBy.DEPTH
    color_map: ColorMap = ColorMap.VIRIDIS
    labels: npt.NDArray[np.uint32] | None = None

    def shades(
        self, points: Float32Array, chosen: npt.NDArray[np.intp], depth: Float32Array | None = None
    ) -> npt.NDArray[np.uint8]:
        """Return (K,) shades 1..255 of the chosen of (N, 4) points.

        Args:
            points: x y z in velo_link, metres, and reflectance.
            chosen: (K,) indices.
            depth: (K,) depth in metres; the distance from the scanner by default.
        """
        if self.by is ColorBy.SEMANTIC:
            labels = np.zeros(len(points), np.uint32) if self.labels is None else self.labels
            return semantic_shades(labels[chosen])
        if self.by is ColorBy.DEPTH:
            shown = np.linalg.norm(points[chosen, :3], axis=1) if depth is None else depth
        else:
            shown = points[chosen, 2 if self.by is ColorBy.HEIGHT else 3]
        return SCALES[self.by].shades(shown)

    def paint(self, picture: Pixels, layer: npt.NDArray[np.uint8]) -> None:
        """Draw (H, W) shades on a picture; EMPTY ones are transparent."""
        cv2.copyTo(colored(layer, self._table()), layer, picture)

    def draw_legend(
        self, picture: Pixels, layer: npt.NDArray[np.uint8], scale: float, *, below: bool = False
    ) -> None:
        """Draw the meaning of the colours: a bar in a corner, or classes along the upper edge.

        Args:
            picture: Drawn on in place.
            layer: The shades shown.
            scale: Scale of the text, 1 for KITTI's images.
            below: True for the lower left corner; else the bar is in the upper left one.
        """
        if self.by is ColorBy.SEMANTIC:
            _draw_classes(picture, layer, scale)
            return
        bar = (round(_BAR_SIZE[0] * scale), round(_BAR_SIZE[1] * scale))
        top = picture.shape[0] - 7 * bar[1] if below else bar[1]
        draw_bar(picture, SCALES[self.by], self.color_map, (bar[1], top), bar)

    def _table(self) -> Pixels:
        return _classes_table() if self.by is ColorBy.SEMANTIC else color_table(self.color_map)


@lru_cache(maxsize=1)
def _classes_table() -> Pixels:
    return semantic_table()


def _draw_classes(picture: Pixels, layer: npt.NDArray[np.uint8], scale: float) -> None:
    """Draw the name of each class shown beside its colour, in lines across the upper edge."""
    text_scale, table = _TEXT_SCALE * scale, _classes_table()
    extent = extent_of('0', text_scale)
    line, swatch = extent.above + extent.below + 2, extent.above
    rows: list[list[tuple[int, str, int]]] = [[]]
    left = swatch
    for name, shade in semantic_names(layer[layer > 0]):
        width = 3 * swatch + extent_of(name, text_scale).width
        if left + width > picture.shape[1] and rows[-1]:
            rows.append([])
            left = swatch
        rows[-1].append((left, name, shade))
        left += width
    strip = picture[: len(rows) * line + 2]
    strip[:] = cv2.convertScaleAbs(strip, alpha=DIM)
    for index, row in enumerate(rows):
        baseline = index * line + extent.above + 1
        for left, name, shade in row:
            color = tuple(table[shade, 0].tolist())
            corner = (left, baseline - swatch + 2)
            cv2.rectangle(strip, corner, (left + swatch - 2, baseline), color, cv2.FILLED)
            put_text(strip, name, (left + 1.5 * swatch, baseline), text_scale)


# Drawing of a scan's points on a camera image, the nearest on top.


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_points(
    picture: Pixels,
    points: Float32Array,
    projection: Projection,
    colors: PointColors = PointColors(),  # noqa: B008 - immutable
    point_size: int = 2,
) -> None:
    """Draw the points visible to the camera, and the legend of their colours.

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
    depth = projection.depth(seen)
    ahead = np.flatnonzero(depth > 0)
    pixels = projection.pixels(seen[ahead])
    u, v = pixels.T
    inside = (u >= -0.5) & (u < size[0] - 0.5) & (v >= -0.5) & (v < size[1] - 0.5)
    chosen = ahead[inside]
    columns_rows = np.rint(pixels[inside]).astype(np.int32)
    return columns_rows, depth[chosen].astype(np.float32), chosen


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
    x, y = (axis.ravel() for axis in np.meshgrid(reach, reach))
    middle = 0.5 if diameter % 2 == 0 else 0.0
    inside = (x - middle) ** 2 + (y - middle) ** 2 <= (diameter / 2) ** 2 + 0.25
    return np.stack([x[inside], y[inside]], axis=1).astype(np.int32)


# Range images of a scan: one row an elevation, one column an azimuth.

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
    sample = elevation[:: max(len(elevation) // _SAMPLE, 1)]
    low, high = np.percentile(sample, [_OUTLIERS, 100 - _OUTLIERS])
    middle, half = (low + high) / 2, max((high - low) / 2, _STEP / 2)
    return np.float32(middle - half), np.float32(middle + half)
