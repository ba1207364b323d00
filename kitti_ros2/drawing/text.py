# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of text: plain text, and tags that do not overlap.

Text is measured: OpenCV 4 draws Hershey's strokes and OpenCV 5 an outline font, which is a fifth
narrower, and whose blanks are half as wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from .strokes import new_picture, size_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from .pixels import Pixels
    from .strokes import Bounds, Color

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
    return ''.join(each if each.isprintable() else '?' for each in shown)


@lru_cache(maxsize=1)
def _blank() -> str:
    """Return what is drawn for a blank: two where one is narrow, so that numbers stay apart."""
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
    place: tuple[float, float],
    scale: float,
    color: Color = WHITE,
    *,
    bold: bool = False,
) -> None:
    """Draw a text whose baseline begins at (x, y)."""
    at = (round(place[0]), round(place[1]))
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
        outlined: Whether the tag is dark with a coloured frame, not filled with the colour.
        beside: Whether it is to the right of its box rather than above.
    """

    text: str
    bounds: Bounds
    color: Color
    outlined: bool = False
    beside: bool = False


def draw_tags(picture: Pixels, tags: Sequence[Tag], scale: float) -> None:
    """Draw tags within the image, each at its box where it overlaps none of the earlier ones."""
    width, height = size_of(picture)
    taken = np.zeros((height, width), bool)
    for tag in tags:
        extent = extent_of(tag.text, scale)
        room = (extent.width + 2 * _PAD, extent.above + extent.below + 2)
        corner = _place(tag, room, taken)
        _part(taken, corner, room)[:] = True
        _draw_tag(picture, tag, corner, room, scale)


def _place(tag: Tag, room: tuple[int, int], taken: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Place a tag above, below, in or farther from its box: the first place of least overlap."""
    left, top, right, bottom = tag.bounds
    width, height = room
    near = (top - height, bottom, top, bottom - height)
    far = [y for gap in _GAPS for y in (top - (gap + 1) * height, bottom + gap * height)]
    aside = [(right + _PAD, top), (left - _PAD - width, top)] if tag.beside else []
    columns = (left, right - width)
    around = [(x, y) for rows in (near, far) for x in columns for y in rows]
    highest = taken.shape[0] - height
    tries = [(x, y) for x, y in (*aside, *around) if 0 <= y <= highest] or [(left, top)]
    placed = np.rint(tries).astype(int)
    placed[:, 0] = placed[:, 0].clip(0, max(taken.shape[1] - width, 0))
    placed[:, 1] = placed[:, 1].clip(0, max(highest, 0))
    corners = [(x, y) for x, y in placed.tolist()]
    # Pixels, not tags, are counted: the cost of a place does not grow with the tags drawn.
    best, least = corners[0], width * height + 1
    for corner in corners:
        overlap = int(np.count_nonzero(_part(taken, corner, room)))
        if overlap < least:
            best, least = corner, overlap
        if not overlap:
            break
    return best


def _part(
    taken: npt.NDArray[np.bool_], corner: tuple[int, int], room: tuple[int, int]
) -> npt.NDArray[np.bool_]:
    """Return the view of a rectangle of the picture."""
    (left, top), (width, height) = corner, room
    return taken[top : top + height, left : left + width]


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
    """Return the line from a distant tag to its box."""
    column = round(min(max(tag.bounds[0], corner[0]), end[0]))
    above, below = round(tag.bounds[1]), round(tag.bounds[3])
    if end[1] + 1 < above:
        cv2.line(picture, (column, end[1]), (column, above), tag.color, 1)
    elif corner[1] > below + 1:
        cv2.line(picture, (column, corner[1]), (column, below), tag.color, 1)
