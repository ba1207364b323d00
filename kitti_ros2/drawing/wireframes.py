# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of 3D boxes on a camera image: their edges, with the front face marked."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import EDGES, clip_bounds
from .boxes_2d import TEXT_SCALE
from .looks import box_color, caption_3d, corners_of, line_width, objects_to_draw, scale_of
from .strokes import cut_segments, dashes, draw_segments, size_of, tint_polygon
from .text import Tag, draw_tags

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
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
    pieces, lines = projection.segments(corners[:, _WIRES].reshape(-1, 2, 3))
    parts, origins = cut_segments(pieces, size)
    wires = lines[origins]
    tags = []
    for place in reversed(range(len(shown))):
        mine = slice(*np.searchsorted(wires, [place * len(_WIRES), (place + 1) * len(_WIRES)]))
        if not len(parts[mine]):
            continue
        each, predicted = shown[place]
        color = box_color(each, predicted=predicted)
        if not predicted:
            front = projection.polygon(corners[place, _FRONT])
            tint_polygon(picture, front, color, _FRONT_ALPHA)
        cross = wires[mine] % len(_WIRES) >= len(EDGES)
        bounds = _within(pieces[lines // len(_WIRES) == place].reshape(-1, 2), size)
        edge_width = 1 if predicted else line_width(each, bounds, scale)
        for chosen, width in ((cross, 1), (~cross, edge_width)):
            strokes = parts[mine][chosen]
            draw_segments(picture, dashes(strokes, scale) if predicted else strokes, color, width)
        if bounds is not None:
            tags.append(Tag(caption_3d(each), bounds, color, predicted))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE * scale)


def _within(ends: Float64Array, size: tuple[int, int]) -> tuple[float, float, float, float] | None:
    """Return the bounds of (N, 2) pixels clipped to the image, None for one out of view."""
    bounds, truncation = clip_bounds(
        np.concatenate([ends.min(axis=0), ends.max(axis=0)])[None], size
    )
    if truncation[0] >= 1:
        return None
    left, top, right, bottom = bounds[0].tolist()
    return left, top, right, bottom
