# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes from above: outlines with their headings, and those that are out of range."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import DONT_CARE
from .looks import box_color, corners_of, is_quiet, objects_to_draw
from .objects import name_of
from .strokes import cut_segments, dashes, draw_segments, sides_of, size_of, slices_of
from .text import Tag, draw_tags

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..options.pictures import BirdOptions
    from .objects import LabelledObject
    from .pixels import Pixels

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

    def pixels(self, places: Float64Array) -> Float64Array:
        """Return (..., 2) column and row of (..., 2) x and y; pixel centres are whole numbers."""
        corner = np.array([self.left_m, self.top_m])
        found: Float64Array = (corner - places[..., ::-1]) * self.pixels_per_metre - 0.5
        return found


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
    shown = objects_to_draw(picture, objects, predictions)
    corners = corners_of(shown)
    outlines = view.pixels(corners[:, :4, :2])
    size, tags = size_of(picture), []
    seen = _Sides.of(outlines, size)
    sides_at = slices_of(seen.owners, len(shown))
    arrows, origins = cut_segments(view.pixels(_arrows(corners)).reshape(-1, 2, 2), size)
    arrows_at = slices_of(origins // _ARROW_LINES, len(shown))
    for place in reversed(range(len(shown))):
        (each, predicted), outline = shown[place], outlines[place]
        color = box_color(each, predicted=predicted)
        if np.isnan(seen.bounds[place, 0]):
            continue
        sides = seen.parts[sides_at[place]]
        small = np.ptp(outline, axis=0).max() < _SMALL
        width = 1 if predicted or small or is_quiet(each) else 2
        draw_segments(picture, dashes(sides, 0.7) if predicted else sides, color, width)
        draw_segments(picture, arrows[arrows_at[place]], color, width)
        left, top, right, bottom = seen.bounds[place].tolist()
        bounds = (left, top, right, bottom)
        tags.append(Tag(name_of(each), bounds, color, outlined=predicted, beside=True))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE)


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
        if not shown:
            continue
        outlines = view.pixels(corners_of([(each, False) for each in shown])[:, :4, :2])
        bounds = _Sides.of(outlines, size).bounds
        out: Counter[str] = Counter()
        flat: Counter[str] = Counter()
        for each, seen in zip(shown, ~np.isnan(bounds[:, 0]), strict=True):
            if each.cuboid is None:
                flat[each.class_name] += each.class_name != DONT_CARE
            elif not seen:
                out[each.class_name] += 1
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
        places, first = np.unique(owners, return_index=True)
        if len(places):
            seen = parts.clip(0, np.array(size) - 1.0)
            bounds[places, :2] = np.minimum.reduceat(seen.min(axis=1), first)
            bounds[places, 2:] = np.maximum.reduceat(seen.max(axis=1), first)
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
