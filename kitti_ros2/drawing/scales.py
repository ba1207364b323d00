# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Colour scales: values to shades, shades to colours, and the colour bar."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from ..options.pictures import ColorBy, ColorMap
from .text import WHITE, extent_of, put_text

if TYPE_CHECKING:
    from ..model.samples import Float32Array
    from .pixels import Pixels

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
        logarithmic: Whether equal ratios of values are equal steps of shade; else differences.
        reverse: Whether the colour map runs from the high value to the low one.
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
    # Of velo_link: KITTI's road is at -1.73 m.
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
