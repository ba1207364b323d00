# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of the objects that the synthetic cameras see, in the manner of KITTI's annotators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import Box, alpha_of, box_to_rect, clip_bounds, project_corners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array, Transform
    from .render import Canvas
    from .scene import PlacedSolid

FARTHEST = 80.0
LEAST_VISIBLE = 0.05
MOST_TRUNCATED = 0.9
_LEAST_PIXELS = 4
_OCCLUDED = ((0.8, 0), (0.4, 1), (0.0, 2))
"""(visible fraction, occlusion level): the level of a fraction above this one."""


def label_solids(
    placed: Sequence[PlacedSolid],
    canvas: Canvas,
    p_rect: Float64Array,
    rect_T_velo: Transform,
    frame: int,
) -> list[Box]:
    """Return the boxes of the objects that a camera sees, by track id.

    Args:
        placed: The drawn boxes, in velo_link.
        canvas: The drawing, with the visible pixels of each object.
        p_rect: (3, 4), rectified camera 0 to this camera's pixels.
        rect_T_velo: velo_link to the rectified camera 0.
        frame: File number.
    """
    visible = np.bincount(canvas.ids.ravel(), minlength=len(placed) + 1)[1:]
    boxes = []
    for index, one in enumerate(placed):
        covered = int(canvas.covered[index])
        if one.solid.class_name is None or covered < _LEAST_PIXELS:
            continue
        part = int(visible[index]) / covered
        if part >= LEAST_VISIBLE:
            box = _label(one, part, (p_rect, canvas.ids.shape), rect_T_velo, frame)
            if box is not None:
                boxes.append(box)
    return sorted(boxes, key=lambda box: box.track_id or 0)


def box_corners(one: PlacedSolid) -> Float64Array:
    """Return the (8, 3) corners of a solid in velo_link, the bottom four, then the top four."""
    footprint = np.array(one.footprint())
    low = one.centre[2]
    levels = (low, low + one.solid.size[2])
    return np.concatenate([np.column_stack([footprint, np.full(4, level)]) for level in levels])


def _label(
    one: PlacedSolid,
    visible: float,
    camera: tuple[Float64Array, tuple[int, ...]],
    rect_T_velo: Transform,
    frame: int,
) -> Box | None:
    """Return the box of a solid, None if it is too far or hardly in the image."""
    p_rect, (height, width) = camera
    (x, y, z), rotation_y = box_to_rect(one.centre, one.yaw, rect_T_velo)
    bounds = project_corners(rect_T_velo.apply(box_corners(one))[None], p_rect)
    cut, truncation = clip_bounds(bounds, (width, height))
    truncated = float(truncation[0])
    if not 0 < z < FARTHEST or truncated > MOST_TRUNCATED:
        return None
    left, top, right, bottom = cut[0].tolist()
    length, box_width, box_height = one.solid.size
    return Box(
        class_name=str(one.solid.class_name),
        truncated=truncated,
        occluded=next(level for least, level in _OCCLUDED if visible >= least),
        alpha=float(alpha_of((x, y, z), rotation_y)[0]),
        box_2d=(left, top, right, bottom),
        size_hwl=(box_height, box_width, length),
        location=(float(x), float(y), float(z)),
        rotation_y=rotation_y,
        frame=frame,
        track_id=one.solid.track_id,
    )
