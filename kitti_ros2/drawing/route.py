# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The path of the car from above, on axes of equal scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from .looks import bgr
from .palette import EGO_COLOR
from .strokes import cut_segments, draw_segments, has_pixels, size_of
from .text import extent_of, put_text

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from .pixels import Pixels
    from .strokes import Color

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
    for place, radius, thickness in ((pixels[0], 4, 1), (pixels[-1], 6, cv2.FILLED)):
        column, row = np.rint(place).astype(int).tolist()
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
