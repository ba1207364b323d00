# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of 2D boxes on a camera image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..model.boxes import DONT_CARE, EDGES, clip_bounds, cuboid_corners
from .looks import box_color, caption_2d, line_width, objects_to_draw, scale_of
from .strokes import cut_segments, dashes, draw_segments, rectangle_segments, size_of, slices_of
from .text import Tag, draw_tags

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from .objects import LabelledObject
    from .pixels import Pixels
    from .projection import Projection

TEXT_SCALE = 0.37
_SHADE = 0.6
_HATCH_GREY = (150, 150, 150)
_HATCH_STEP = 9


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_boxes_2d(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    projection: Projection | None = None,
    *,
    predictions: Sequence[LabelledObject] = (),
    labelled: bool = True,
    named: bool = True,
) -> None:
    """Draw the 2D box of each object, with its tag; DontCare regions are shaded.

    Args:
        picture: (H, W, 3) uint8 BGR, drawn on in place.
        objects: Of the frame.
        projection: Into the picture, for the bounds of objects without a 2D box in it; None leaves
            those out.
        labelled: Whether the 2D boxes are in pixels of this picture.
        predictions: Drawn in the style of predictions.
        named: Whether boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    shown = objects_to_draw(picture, objects, predictions)
    size, scale = size_of(picture), scale_of(picture)
    bounds = object_bounds([each for each, _ in shown], projection, size, labelled=labelled)
    cut, _ = clip_bounds(bounds, size)
    sides, origins = cut_segments(rectangle_segments(np.rint(bounds)), size)
    sides_at = slices_of(origins // 4, len(shown))
    tags = []
    for place in reversed(np.flatnonzero(~np.isnan(cut[:, 0])).tolist()):
        each, predicted = shown[place]
        if each.class_name == DONT_CARE:
            _shade(picture, cut[place])
            continue
        color, seen = box_color(each, predicted=predicted), tuple(cut[place].tolist())
        mine = sides[sides_at[place]]
        if predicted:
            draw_segments(picture, dashes(mine, scale), color)
        else:
            draw_segments(picture, mine, color, line_width(each, seen, scale))
        tags.append(Tag(caption_2d(each), seen, color, predicted))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE * scale)


def object_bounds(
    objects: Sequence[LabelledObject],
    projection: Projection | None,
    size: tuple[int, int],
    *,
    labelled: bool,
) -> Float64Array:
    """Return (N, 4) left, top, right, bottom of the objects, pixels; NaN for one out of view.

    On the labelled picture this is the label's own 2D box, unchanged; else the bounds of the
    projected 3D box, clipped to the image.
    """
    bounds = np.full((len(objects), 4), np.nan)
    solid: list[tuple[int, Cuboid]] = []
    for place, each in enumerate(objects):
        if labelled and each.box_2d is not None:
            left, top, right, bottom = each.box_2d
            bounds[place] = each.box_2d if right >= left and bottom >= top else np.nan
        elif each.cuboid is not None:
            solid.append((place, each.cuboid))
    if projection is not None and solid:
        found = projected_bounds(cuboid_corners([cuboid for _, cuboid in solid]), projection)
        bounds[[place for place, _ in solid]], _ = clip_bounds(found, size)
    return bounds


def projected_bounds(corners: Float64Array, projection: Projection) -> Float64Array:
    """Return (N, 4) bounds of (N, 8, 3) boxes in velo_link, not clipped; NaN for one out of view.

    As boxes.project_corners, and also for edges that the lens bends.
    """
    pieces, lines = projection.segments(corners[:, EDGES].reshape(-1, 2, 3))
    owners = lines // len(EDGES)
    bounds = np.full((len(corners), 4), np.nan)
    places, first = np.unique(owners, return_index=True)
    if len(places):
        bounds[places, :2] = np.minimum.reduceat(pieces.min(axis=1), first)
        bounds[places, 2:] = np.maximum.reduceat(pieces.max(axis=1), first)
    return bounds


def _shade(picture: Pixels, bounds: Float64Array) -> None:
    """Darken and hatch a region."""
    left, top, right, bottom = np.rint(bounds).astype(int)
    window = picture[top : bottom + 1, left : right + 1]
    window[:] = cv2.convertScaleAbs(window, alpha=_SHADE)
    height, width = window.shape[:2]
    starts = np.arange(_HATCH_STEP, width + height, _HATCH_STEP, dtype=np.float64)
    hatch = np.stack(
        [
            np.stack([starts, np.zeros_like(starts)], axis=1),
            np.stack([starts - height, np.full_like(starts, height)], axis=1),
        ],
        axis=1,
    )
    lines, _ = cut_segments(hatch, (width, height))
    draw_segments(window, lines, _HATCH_GREY)
    cv2.rectangle(picture, (left, top), (right, bottom), _HATCH_GREY, 1)
