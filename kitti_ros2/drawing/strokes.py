# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of anti-aliased lines and areas into (H, W, 3) uint8 BGR images, with any coordinates.

OpenCV uses fixed point, and overflow wraps around into the image, so everything is clipped to the
image in floating point first. Coordinates are pixels, (0, 0) the centre of the first one.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from ..model.geometry import cut_polygon_by

if TYPE_CHECKING:
    from ..model.geometry import Float64Array
    from .pixels import Pixels

Color: TypeAlias = tuple[int, int, int]
"""Blue, green, red, 0..255."""

Bounds: TypeAlias = tuple[float, float, float, float]
"""left, top, right, bottom, pixels."""

_SHIFT = 4
_MARGIN = 8.0
"""Length of a clipped line beyond the image, so that its end is invisible; pixels."""

_DASH, _GAP = 7.0, 5.0
_FARTHEST = 1e12


def has_pixels(picture: Pixels) -> bool:
    """Whether a picture has any pixels.

    Raises:
        ValueError: It is not a writable (H, W, 3) uint8 array.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise ValueError(f'a picture is (H, W, 3) uint8, not {picture.shape} {picture.dtype}')
    if not picture.flags.writeable:
        raise ValueError('the picture is read-only; draw on a copy')
    return picture.size > 0


def new_picture(size: tuple[int, int], color: Color) -> Pixels:
    """Return a (H, W, 3) picture of one colour, of a (width, height)."""
    picture = np.empty((size[1], size[0], 3), np.uint8)
    cv2.rectangle(picture, (0, 0), size, color, cv2.FILLED)
    return picture


def size_of(picture: Pixels) -> tuple[int, int]:
    """Return (width, height)."""
    return picture.shape[1], picture.shape[0]


def cut_segments(
    segments: Float64Array, size: tuple[int, int]
) -> tuple[Float64Array, npt.NDArray[np.intp]]:
    """Clip lines to an image, by Liang and Barsky (1984).

    Args:
        segments: (M, 2, 2) ends in pixels; lines with NaN or infinity are left out.
        size: (width, height).

    Returns:
        (K, 2, 2) parts, at most a margin outside; (K,) the line of each.
    """
    lines = np.flatnonzero((np.abs(segments) < _FARTHEST).all(axis=(1, 2)))
    start, end = segments[lines, 0], segments[lines, 1]
    low, high = np.full(2, -_MARGIN), np.array(size) - 1.0 + _MARGIN
    delta = end - start
    level = delta == 0
    step = np.where(level, 1.0, delta)
    with np.errstate(over='ignore'):
        crossings = np.stack([(low - start) / step, (high - start) / step])
    outside = level & ((start < low) | (start > high))
    enter = np.where(level, np.where(outside, 2.0, 0.0), crossings.min(axis=0)).max(axis=1)
    leave = np.where(level, np.where(outside, -1.0, 1.0), crossings.max(axis=0)).min(axis=1)
    enter, leave = np.maximum(enter, 0.0), np.minimum(leave, 1.0)
    seen = enter <= leave
    shares = np.stack([enter, leave], axis=1)[seen, :, None]
    return start[seen, None] + shares * delta[seen, None], lines[seen]


def slices_of(owners: npt.NDArray[np.intp], count: int) -> list[slice]:
    """Return where the parts of each of `count` shapes are.

    Args:
        owners: (K,) the shape of each part, ascending.
        count: Number of shapes.
    """
    starts = np.searchsorted(owners, np.arange(count + 1)).tolist()
    return [slice(start, end) for start, end in pairwise(starts)]


def dashes(segments: Float64Array, scale: float = 1.0) -> Float64Array:
    """Return (K, 2, 2) dashes of (M, 2, 2) lines; each line begins and ends with one.

    Args:
        segments: In pixels, clipped to an image.
        scale: Of dash and gap.
    """
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    period = (_DASH + _GAP) * scale
    counts = np.rint((lengths + _GAP * scale) / period).astype(int).clip(1)
    owner = np.repeat(np.arange(len(segments)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    # Dash and gap keep their ratio on lines of any length.
    unit = 1.0 / (counts[owner] * (_DASH + _GAP) - _GAP)
    begin = place * (_DASH + _GAP) * unit
    shares = np.stack([begin, begin + _DASH * unit], axis=1)[..., None]
    start, end = segments[owner, 0][:, None], segments[owner, 1][:, None]
    pieces: Float64Array = start + shares * (end - start)
    return pieces


def draw_segments(picture: Pixels, segments: Float64Array, color: Color, width: int = 1) -> None:
    """Draw (K, 2, 2) lines that cut_segments returned."""
    if len(segments):
        points = np.rint(segments * (1 << _SHIFT)).astype(np.int32)
        cv2.polylines(
            picture, list(points), isClosed=False, color=color, thickness=width,
            lineType=cv2.LINE_AA, shift=_SHIFT,
        )  # fmt: skip


def cut_polygon(corners: Float64Array, size: tuple[int, int]) -> Float64Array:
    """Clip a convex (V, 2) polygon to an image, by Sutherland and Hodgman (1974); (K, 2)."""
    if not (np.abs(corners) < _FARTHEST).all():
        return np.empty((0, 2))
    for axis in (0, 1):
        for sign, bound in ((1.0, -_MARGIN), (-1.0, -(size[axis] - 1.0 + _MARGIN))):
            inside = sign * corners[:, axis] - bound
            if (inside < 0).any():
                corners = cut_polygon_by(corners, inside)
    return corners


def tint_polygon(picture: Pixels, corners: Float64Array, color: Color, alpha: float) -> None:
    """Draw a translucent colour over a convex (V, 2) polygon."""
    corners = cut_polygon(corners, size_of(picture))
    if len(corners) < 3:
        return
    low = np.floor(corners.min(axis=0)).astype(int).clip(0)
    high = (np.ceil(corners.max(axis=0)).astype(int) + 1).clip(0, size_of(picture))
    if (high <= low).any():
        return
    window = picture[low[1] : high[1], low[0] : high[0]]
    tinted = window.copy()
    points = np.rint((corners - low) * (1 << _SHIFT)).astype(np.int32)
    cv2.fillConvexPoly(tinted, points, color, cv2.LINE_AA, _SHIFT)
    cv2.addWeighted(tinted, alpha, window, 1 - alpha, 0.0, dst=tinted)
    window[:] = tinted


def rectangle_segments(bounds: Float64Array) -> Float64Array:
    """Return (4 N, 2, 2) sides of (N, 4) rectangles left, top, right, bottom."""
    return sides_of(bounds[:, [[0, 1], [2, 1], [2, 3], [0, 3]]]).reshape(-1, 2, 2)


def sides_of(corners: Float64Array) -> Float64Array:
    """Return (..., V, 2, D) sides of polygons of (..., V, D) corners."""
    return np.stack([corners, np.roll(corners, -1, axis=-2)], axis=-2)
