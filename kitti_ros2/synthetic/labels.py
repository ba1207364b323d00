# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels of what the synthetic cameras see, as KITTI's annotators would have drawn them."""

from __future__ import annotations

from math import atan2, pi
from typing import TYPE_CHECKING

import numpy as np

from ..boxes import Box
from ..kitti.box_frames import box_to_rect

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..geometry import Float64Array, Transform
    from .render import Canvas
    from .scene import PlacedSolid

FARTHEST = 80.0
LEAST_VISIBLE = 0.05
MOST_TRUNCATED = 0.9
_LEAST_PIXELS = 4
_NEAR = 0.1
_OCCLUDED = ((0.8, 0), (0.4, 1), (0.0, 2))
"""A visible part above the first number is the occlusion level of the second."""

_EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)


def label_solids(
    placed: Sequence[PlacedSolid],
    canvas: Canvas,
    p_rect: Float64Array,
    rect_T_velo: Transform,
    frame: int,
) -> list[Box]:
    """The boxes of the objects that a camera sees, by track id.

    Args:
        placed: What was drawn, in velo_link.
        canvas: The drawing, which tells how much of each object is visible.
        p_rect: (3, 4), rectified camera 0 to this camera's pixels.
        rect_T_velo: velo_link to the rectified camera 0.
        frame: File number.
    """
    visible = np.bincount(canvas.ids.ravel(), minlength=len(placed) + 1)[1:]
    boxes = []
    for index, one in enumerate(placed):
        covered = int(canvas.covered[index])
        if one.solid.kind is None or covered < _LEAST_PIXELS:
            continue
        part = int(visible[index]) / covered
        if part >= LEAST_VISIBLE:
            box = _label(one, part, (p_rect, canvas.ids.shape), rect_T_velo, frame)
            if box is not None:
                boxes.append(box)
    return sorted(boxes, key=lambda box: box.track_id or 0)


def project_box(
    corners: Float64Array, p_rect: Float64Array
) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of eight corners' projection, before it is cut to the image.

    A box that reaches behind the camera is cut just in front of it. None if all of it is behind.

    Args:
        corners: (8, 3), the bottom four, then the top four, in the rectified camera 0.
        p_rect: (3, 4).
    """
    projected = corners @ p_rect[:, :3].T + p_rect[:, 3]
    start, end = projected[_EDGES[:, 0]], projected[_EDGES[:, 1]]
    crossing = (start[:, 2] < _NEAR) != (end[:, 2] < _NEAR)
    start, end = start[crossing], end[crossing]
    share = (_NEAR - start[:, 2]) / (end[:, 2] - start[:, 2])
    points = np.concatenate(
        [projected[projected[:, 2] >= _NEAR], start + share[:, None] * (end - start)]
    )
    if not len(points):
        return None
    pixels = points[:, :2] / points[:, 2:]
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


def box_corners(one: PlacedSolid) -> Float64Array:
    """(8, 3) corners of a solid in velo_link, the bottom four, then the top four."""
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
    """The box of a solid, None where it is too far or too little of it is in the image."""
    p_rect, (height, width) = camera
    bounds = project_box(rect_T_velo.apply(box_corners(one)), p_rect)
    (x, y, z), rotation_y = box_to_rect(one.centre, one.yaw, rect_T_velo)
    if bounds is None or not 0 < z < FARTHEST:
        return None
    left, right = np.clip([bounds[0], bounds[2]], 0, width - 1)
    top, bottom = np.clip([bounds[1], bounds[3]], 0, height - 1)
    whole = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    truncated = 1 - (right - left) * (bottom - top) / whole
    if truncated > MOST_TRUNCATED:
        return None
    length, box_width, box_height = one.solid.size
    return Box(
        kind=str(one.solid.kind),
        truncated=max(float(truncated), 0.0),
        occluded=next(level for least, level in _OCCLUDED if visible >= least),
        alpha=wrap_angle(rotation_y - atan2(x, z)),
        box_2d=(float(left), float(top), float(right), float(bottom)),
        size_hwl=(box_height, box_width, length),
        location=(float(x), float(y), float(z)),
        rotation_y=rotation_y,
        frame=frame,
        track_id=one.solid.track_id,
    )


def wrap_angle(angle: float) -> float:
    """An angle in radians brought to [-pi, pi)."""
    return (angle + pi) % (2 * pi) - pi
