# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A scan and its boxes in perspective, from above and behind the car, with a grid on the ground."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..model.boxes import EDGES, Cuboid, cuboid_corners
from ..model.geometry import Transform
from .birds_eye import BACKGROUND, BY_HEIGHT, EGO_MIDDLE_X
from .looks import bgr, scale_of
from .palette import EGO_COLOR, EGO_SIZE_LWH
from .points import scatter, seen_points
from .projection import Projection
from .strokes import cut_segments, draw_segments, new_picture, size_of
from .text import extent_of, put_text
from .wireframes import draw_wireframes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.geometry import Float64Array
    from ..model.samples import Float32Array
    from .objects import LabelledObject
    from .pixels import Pixels
    from .point_colors import PointColors

SIZE = (1280, 720)
"""(width, height), pixels."""

_EYE = np.array([-13.0, 4.0, 9.0])
_TARGET = np.array([14.0, 0.0, -1.5])
_VIEW_ANGLE = math.radians(70.0)
"""Horizontal."""

_GROUND_Z = -1.73
"""Of KITTI's road below its scanner, metres."""

_GRID_X, _GRID_Y, _GRID_STEP = (-20, 80), (-40, 40), 10
_LABELS = (10, 20, 30, 40, 60, 80)
_GRID_COLOR = (66, 60, 55)
_GRID_TEXT = (186, 178, 172)
_TEXT_SCALE = 0.4


def view_from_behind(size: tuple[int, int] = SIZE) -> Projection:
    """Return the projection of velo_link to a picture of a (width, height)."""
    forward = (_TARGET - _EYE) / np.linalg.norm(_TARGET - _EYE)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    focal = size[0] / 2 / math.tan(_VIEW_ANGLE / 2)
    k = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    return Projection(k @ np.column_stack([rotation, -rotation @ _EYE]))


@np.errstate(all='ignore')  # labels and scans may hold any numbers
def draw_perspective(
    points: Float32Array | None,
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    colors: PointColors = BY_HEIGHT,
    point_size: int = 2,
    *,
    named: bool = True,
) -> Pixels:
    """Draw a scan and boxes in perspective into a new picture of SIZE.

    Args:
        points: (N, 4) x y z in velo_link, metres, and reflectance; None without a scan.
        objects: Ground truth; those without a 3D box are left out.
        predictions: Drawn in the style of predictions.
        colors: The colours of points; depth is the distance from the scanner.
        point_size: Diameter of a point, pixels.
        named: Whether boxes have tags.
    """
    picture = new_picture(SIZE, BACKGROUND)
    projection = view_from_behind()
    _draw_grid(picture, projection)
    layer = None
    if points is not None:
        pixels, depth, chosen = seen_points(points, projection, SIZE)
        order = np.argsort(-depth)  # a nearer point covers those behind it
        shades = colors.shades(points, chosen[order])
        layer = scatter(pixels[order], shades, SIZE, point_size)
        colors.paint(picture, layer)
    _label_grid(picture, projection)
    _draw_car(picture, projection)
    draw_wireframes(picture, objects, projection, predictions, named=named)
    if layer is not None:
        colors.draw_legend(picture, layer, scale_of(picture))
    return picture


def _draw_grid(picture: Pixels, projection: Projection) -> None:
    """Draw lines on the ground, 10 m apart."""
    xs = np.arange(_GRID_X[0], _GRID_X[1] + 1, _GRID_STEP)
    ys = np.arange(_GRID_Y[0], _GRID_Y[1] + 1, _GRID_STEP)
    across = [[(x, ys[0], _GROUND_Z), (x, ys[-1], _GROUND_Z)] for x in xs]
    along = [[(xs[0], y, _GROUND_Z), (xs[-1], y, _GROUND_Z)] for y in ys]
    _draw_lines(picture, projection, np.array(across + along, np.float64), _GRID_COLOR, 1)


def _label_grid(picture: Pixels, projection: Projection) -> None:
    """Write the distance of lines ahead of the scanner, halfway to their right end."""
    scale = _TEXT_SCALE * scale_of(picture)
    for x in _LABELS:
        label = f'{x} m'
        place = projection.pixels(projection.homogeneous((x, _GRID_Y[0] / 2, _GROUND_Z)))
        left = place[0] - extent_of(label, scale).width / 2
        put_text(picture, label, (left, place[1] - 2), scale, _GRID_TEXT)


def _draw_car(picture: Pixels, projection: Projection) -> None:
    """Draw the edges of the recording car."""
    middle = np.array([EGO_MIDDLE_X, 0.0, _GROUND_Z + EGO_SIZE_LWH[2] / 2])
    car = Cuboid('', '', Transform(np.eye(3), middle), EGO_SIZE_LWH)
    _draw_lines(picture, projection, cuboid_corners([car])[0, EDGES], bgr(EGO_COLOR), 2)


def _draw_lines(
    picture: Pixels,
    projection: Projection,
    ends: Float64Array,
    color: tuple[int, int, int],
    width: int,
) -> None:
    """Draw (M, 2, 3) lines in velo_link."""
    pieces, _ = projection.segments(ends)
    draw_segments(picture, cut_segments(pieces, size_of(picture))[0], color, width)
