# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of 3D boxes on a camera image: their edges, with the front face marked."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import EDGES, clip_bounds
from .boxes_2d import TEXT_SCALE, projected_bounds
from .looks import box_color, caption_3d, corners_of, line_width, objects_to_draw, scale_of
from .strokes import cut_segments, dashes, draw_segments, sides_of, size_of, slices_of, tint_polygon
from .text import Tag, draw_tags

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .objects import LabelledObject
    from .pixels import Pixels
    from .projection import Projection

_FRONT = np.array([0, 1, 5, 4])
_WIRES = np.concatenate([EDGES, [(0, 5), (1, 4)]])
"""Pairs of corners joined by a line: the edges, and the cross of the front face."""

_FRONT_ALPHA = 0.3


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_wireframes(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    projection: Projection,
    predictions: Sequence[LabelledObject] = (),
    *,
    named: bool = True,
) -> None:
    """Draw the edges of each object's 3D box, with its tag; the front face is crossed.

    The front face of ground truth is tinted too. Parts behind the camera, and objects without a 3D
    box, are left out.

    Args:
        picture: (H, W, 3) uint8 BGR, drawn on in place.
        objects: Of the frame.
        projection: Into the picture.
        predictions: Drawn in the style of predictions.
        named: Whether boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    shown = objects_to_draw(picture, objects, predictions)
    corners = corners_of(shown)
    size, scale = size_of(picture), scale_of(picture)
    bounds, _ = clip_bounds(projected_bounds(corners, projection), size)
    sides, owners = projection.segments(sides_of(corners[:, _FRONT]).reshape(-1, 2, 3))
    fronts_at = slices_of(owners // len(_FRONT), len(shown))
    pieces, lines = projection.segments(corners[:, _WIRES].reshape(-1, 2, 3))
    parts, origins = cut_segments(pieces, size)
    wires = lines[origins]
    wires_at = slices_of(wires // len(_WIRES), len(shown))
    tags = []
    for place in reversed(range(len(shown))):
        mine = wires_at[place]
        if not len(parts[mine]):
            continue
        each, predicted = shown[place]
        color = box_color(each, predicted=predicted)
        if not predicted:
            front = sides[fronts_at[place]].reshape(-1, 2)
            tint_polygon(picture, front, color, _FRONT_ALPHA)
        cross = wires[mine] % len(_WIRES) >= len(EDGES)
        left, top, right, bottom = bounds[place].tolist()
        seen = None if math.isnan(left) else (left, top, right, bottom)
        edge_width = 1 if predicted else line_width(each, seen, scale)
        for chosen, width in ((cross, 1), (~cross, edge_width)):
            strokes = parts[mine][chosen]
            draw_segments(picture, dashes(strokes, scale) if predicted else strokes, color, width)
        if seen is not None:
            tags.append(Tag(caption_3d(each), seen, color, predicted))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE * scale)
