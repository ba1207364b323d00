# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of lines, areas and text, and the appearance of objects."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import cv2
import numpy as np
import numpy.typing as npt

from ..model.boxes import Verdict, cuboid_corners
from ..model.geometry import cut_polygon_by
from .labelled_objects import (
    NEUTRAL_COLOR,
    PREDICTION_COLOR,
    VERDICT_COLORS,
    distance_of,
    name_of,
    rgb_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from .labelled_objects import LabelledObject, Pixels


# Drawing of anti-aliased lines and areas into (H, W, 3) uint8 BGR images, with any coordinates.
#
# OpenCV uses fixed point, and overflow wraps around into the image, so everything is clipped to the
# image in floating point first. Coordinates are pixels, (0, 0) the centre of the first one.

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
    """Return whether a picture has any pixels.

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
    """Return the slices of the parts of each of `count` shapes.

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
        scale: Scale of dash and gap.
    """
    lengths = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    period = (_DASH + _GAP) * scale
    counts = np.rint((lengths + _GAP * scale) / period).astype(int).clip(1)
    owner = np.repeat(np.arange(len(segments)), counts)
    index = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    # Dash and gap keep their ratio on lines of any length.
    step = 1.0 / (counts[owner] * (_DASH + _GAP) - _GAP)
    begin = index * (_DASH + _GAP) * step
    shares = np.stack([begin, begin + _DASH * step], axis=1)[..., None]
    start, end = segments[owner, 0][:, None], segments[owner, 1][:, None]
    dashed: Float64Array = start + shares * (end - start)
    return dashed


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


# Drawing of text: plain text, and tags that do not overlap.
#
# Text is measured: OpenCV 4 draws Hershey's strokes and OpenCV 5 an outline font, which is a fifth
# narrower, and whose blanks are half as wide.

BLACK: Color = (0, 0, 0)
WHITE: Color = (255, 255, 255)
LONGEST = 160
"""Most characters of a drawn text; class names may be of any length."""

_REGULAR, _BOLD = cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX
_PAD = 3
_CAPTION_SCALE = 0.6
_GAPS = (1.5, 3.0, 4.5, 6.0)
"""Greatest distance of a tag from its box, in heights of the tag."""


class Extent(NamedTuple):
    """The size of a text, pixels: its width, and its height above and below the baseline."""

    width: int
    above: int
    below: int


def printable(text: str) -> str:
    """Return the text as one line of bounded length."""
    shown = text if len(text) <= LONGEST else text[: LONGEST - 3] + '...'
    return ''.join(character if character.isprintable() else '?' for character in shown)


@lru_cache(maxsize=1)
def _blank() -> str:
    """Return one blank, or two if a blank is narrow, so that numbers stay apart."""
    (blank, _), _ = cv2.getTextSize(' ', _REGULAR, 1.0, 1)
    (digit, _), _ = cv2.getTextSize('0', _REGULAR, 1.0, 1)
    return ' ' if blank > 0.6 * digit else '  '


def _drawn(text: str) -> str:
    return printable(text).replace(' ', _blank())


@lru_cache(maxsize=4096)
def extent_of(text: str, scale: float, *, bold: bool = False) -> Extent:
    """Measure a text; the height is that of the font, for any letters."""
    font = _BOLD if bold else _REGULAR
    (width, _), _ = cv2.getTextSize(_drawn(text), font, scale, 1)
    return Extent(width, round(22 * scale), round(7 * scale))


def fitted(text: str, width: int, scale: float, *, bold: bool = False) -> str:
    """Return the text, or as much of its beginning as fits a width in pixels."""
    shown = printable(text)
    while len(shown) > 4 and extent_of(shown, scale, bold=bold).width > width:
        shown = shown[:-4] + '...'
    return shown


def put_text(
    picture: Pixels,
    text: str,
    start: tuple[float, float],
    scale: float,
    color: Color = WHITE,
    *,
    bold: bool = False,
) -> None:
    """Draw a text whose baseline begins at (x, y)."""
    at = (round(start[0]), round(start[1]))
    width, height = size_of(picture)
    if -width <= at[0] < width and -height <= at[1] < 2 * height:
        font = _BOLD if bold else _REGULAR
        cv2.putText(picture, _drawn(text), at, font, scale, color, 1, cv2.LINE_AA)


def captioned(picture: Pixels, text: str) -> Pixels:
    """Return a taller picture with a line of text above it."""
    width, height = size_of(picture)
    extent = extent_of(text, _CAPTION_SCALE)
    room = extent.above + extent.below + 4 * _PAD
    page = new_picture((width, room + height), BLACK)
    shown = fitted(text, width - 4 * _PAD, _CAPTION_SCALE)
    put_text(page, shown, (2 * _PAD, 2 * _PAD + extent.above), _CAPTION_SCALE)
    page[room:] = picture
    return page


def ink_for(color: Color) -> Color:
    """Return black or white, for contrast with a colour (luma of ITU-R BT.601)."""
    blue, green, red = color
    return BLACK if 0.299 * red + 0.587 * green + 0.114 * blue > 110 else WHITE


@dataclass(frozen=True)
class Tag:
    """The caption of a box.

    Attributes:
        text: One line.
        bounds: left, top, right, bottom of the box, pixels, within the image.
        color: The box's.
        outlined: True if the tag is dark with a coloured border, not filled with the colour.
        beside: True if it is to the right of its box rather than above.
    """

    text: str
    bounds: Bounds
    color: Color
    outlined: bool = False
    beside: bool = False


def draw_tags(picture: Pixels, tags: Sequence[Tag], scale: float) -> None:
    """Draw tags within the image, each at its box where it overlaps none of the earlier ones."""
    width, height = size_of(picture)
    occupied = np.zeros((height, width), bool)
    for tag in tags:
        extent = extent_of(tag.text, scale)
        room = (extent.width + 2 * _PAD, extent.above + extent.below + 2)
        corner = _place(tag, room, occupied)
        _part(occupied, corner, room)[:] = True
        _draw_tag(picture, tag, corner, room, scale)


def _place(tag: Tag, room: tuple[int, int], occupied: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Place a tag above, below, in or farther from its box, with the least overlap."""
    left, top, right, bottom = tag.bounds
    width, height = room
    near = (top - height, bottom, top, bottom - height)
    far = [y for gap in _GAPS for y in (top - (gap + 1) * height, bottom + gap * height)]
    aside = [(right + _PAD, top), (left - _PAD - width, top)] if tag.beside else []
    columns = (left, right - width)
    around = [(x, y) for rows in (near, far) for x in columns for y in rows]
    highest = occupied.shape[0] - height
    tries = [(x, y) for x, y in (*aside, *around) if 0 <= y <= highest] or [(left, top)]
    placed = np.rint(tries).astype(int)
    placed[:, 0] = placed[:, 0].clip(0, max(occupied.shape[1] - width, 0))
    placed[:, 1] = placed[:, 1].clip(0, max(highest, 0))
    corners = [(x, y) for x, y in placed.tolist()]
    # Pixels, not tags, are counted: the cost of a position does not grow with the tags drawn.
    best, least = corners[0], width * height + 1
    for corner in corners:
        overlap = int(np.count_nonzero(_part(occupied, corner, room)))
        if overlap < least:
            best, least = corner, overlap
        if not overlap:
            break
    return best


def _part(
    occupied: npt.NDArray[np.bool_], corner: tuple[int, int], room: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """Return the view of a rectangle of the picture."""
    (left, top), (width, height) = corner, room
    return occupied[top : top + height, left : left + width]


def _draw_tag(
    picture: Pixels, tag: Tag, corner: tuple[int, int], room: tuple[int, int], scale: float
) -> None:
    left, top = corner
    end = (left + room[0] - 1, top + room[1] - 1)
    fill, ink = (BLACK, WHITE) if tag.outlined else (tag.color, ink_for(tag.color))
    if not tag.beside:
        _draw_leader(picture, tag, corner, end)
    cv2.rectangle(picture, corner, end, fill, cv2.FILLED)
    if tag.outlined:
        cv2.rectangle(picture, corner, end, tag.color, 1)
    baseline = top + 1 + extent_of(tag.text, scale).above
    put_text(picture, tag.text, (left + _PAD, baseline), scale, ink)


def _draw_leader(picture: Pixels, tag: Tag, corner: tuple[int, int], end: tuple[int, int]) -> None:
    """Draw the line from a distant tag to its box."""
    column = round(min(max(tag.bounds[0], corner[0]), end[0]))
    above, below = round(tag.bounds[1]), round(tag.bounds[3])
    if end[1] + 1 < above:
        cv2.line(picture, (column, end[1]), (column, above), tag.color, 1)
    elif corner[1] > below + 1:
        cv2.line(picture, (column, corner[1]), (column, below), tag.color, 1)


# The appearance of an object: its colour, caption and line width.
#
# Ground truth has the colour of its class, solid lines and a filled tag; predictions have a colour
# of their own, dashed lines and an outlined tag. After a comparison, predictions have the colour of
# true or of false positives, labels without a prediction that of misses, and all others are grey;
# tags show TP or FP and the intersection over union, or FN. Lines of occluded and of small objects
# and of matched labels are half as wide; the tag of a 2D box shows the occlusion (KITTI's 1 partly,
# 2 largely, ? unknown) and the truncation.

PREDICTION_BGR = PREDICTION_COLOR[::-1]
_KITTI_AREA = 1242 * 375
_SMALL = 40.0
_OCCLUSIONS = {1: ' occ 1', 2: ' occ 2', 3: ' occ ?'}


def bgr(rgb: tuple[float, float, float]) -> Color:
    """Convert red, green, blue in 0..1 to the colours of OpenCV."""
    red, green, blue = (round(255 * share) for share in rgb)
    return blue, green, red


def class_color(class_name: str) -> Color:
    """Return the colour of a class."""
    red, green, blue = rgb_of(class_name)
    return blue, green, red


def box_color(obj: LabelledObject, *, predicted: bool) -> Color:
    """Return the colour of an object's box: where it was compared, that of the result."""
    if obj.match is None:
        return PREDICTION_BGR if predicted else class_color(obj.class_name)
    verdict = obj.match.verdict
    detected = not predicted and verdict is Verdict.TRUE_POSITIVE
    rgb = NEUTRAL_COLOR if detected or verdict is None else VERDICT_COLORS[verdict]
    return rgb[::-1]


def is_quiet(obj: LabelledObject) -> bool:
    """Return whether an object was compared and is no error."""
    errors = (Verdict.FALSE_POSITIVE, Verdict.FALSE_NEGATIVE)
    return obj.match is not None and obj.match.verdict not in errors


def scale_of(picture: Pixels) -> float:
    """Return the scale of lines and letters: 1 in KITTI's images, more in larger ones."""
    return scale_for((picture.shape[1], picture.shape[0]))


def scale_for(size: tuple[int, int]) -> float:
    """Return the scale of lines and letters for the (width, height) of a picture."""
    return min(max(math.sqrt(size[0] * size[1] / _KITTI_AREA), 1.0), 3.0)


def line_width(obj: LabelledObject, bounds: Bounds | None, scale: float) -> int:
    """Return the line width of a box with these bounds in the image, pixels."""
    small = bounds is None or min(bounds[2] - bounds[0], bounds[3] - bounds[1]) < _SMALL * scale
    thin = obj.occluded or small or is_quiet(obj)
    return max(round((1.0 if thin else 2.0) * scale), 1)


def caption_2d(obj: LabelledObject) -> str:
    """Format class, track, score, occlusion and truncation."""
    occlusion = _OCCLUSIONS.get(obj.occluded or 0, '')
    return name_of(obj) + occlusion + _truncation(obj.truncated or 0.0)


def _truncation(share: float) -> str:
    """Format the part outside the image; tracking labels have only a level (1, 2)."""
    if not share > 0:
        return ''
    return f' trunc {100 * share:.0f}%' if share < 1 else ' trunc'


def caption_3d(obj: LabelledObject) -> str:
    """Format class, track, score and distance."""
    return f'{name_of(obj)}, {distance_of(obj):.1f} m'


def objects_to_draw(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject] = (),
) -> list[tuple[LabelledObject, bool]]:
    """Return objects by ascending distance, each with whether it is a prediction.

    A picture without pixels has none.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    if not has_pixels(picture):
        return []
    drawn = [(obj, False) for obj in objects] + [(obj, True) for obj in predictions]
    return sorted(drawn, key=lambda pair: distance_of(pair[0]))


def corners_of(shown: Sequence[tuple[LabelledObject, bool]]) -> Float64Array:
    """Return the (N, 8, 3) corners of 3D boxes in velo_link, metres; NaN without a box."""
    corners = np.full((len(shown), 8, 3), np.nan)
    solid = [index for index, (obj, _) in enumerate(shown) if obj.cuboid is not None]
    cuboids = [obj.cuboid for obj, _ in shown if obj.cuboid is not None]
    corners[solid] = cuboid_corners(cuboids)
    return corners
