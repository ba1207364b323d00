# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The objects of a frame on a camera image: projection, 2D boxes, 3D boxes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from ..model.boxes import DONT_CARE, EDGES, clip_bounds, cuboid_corners
from .labelled_objects import LABEL_CAMERA, NEUTRAL_COLOR, distance_of, name_of
from .primitives import (
    Tag,
    box_color,
    caption_2d,
    caption_3d,
    corners_of,
    cut_segments,
    dashes,
    draw_segments,
    draw_tags,
    ink_for,
    line_width,
    objects_to_draw,
    rectangle_segments,
    scale_for,
    scale_of,
    sides_of,
    size_of,
    slices_of,
    tint_polygon,
)
from .projection import Projection

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from ..model.samples import Calibration
    from .labelled_objects import LabelledObject, Pixels
    from .primitives import Bounds, Color


# Drawing of 2D boxes on a camera image.

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
        objects: Labels of the frame.
        projection: Into the picture, for the bounds of objects without a 2D box in it; None leaves
            those out.
        labelled: True if the 2D boxes are in pixels of this picture.
        predictions: Drawn in the style of predictions.
        named: True if boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    shown = objects_to_draw(picture, objects, predictions)
    size, scale = size_of(picture), scale_of(picture)
    bounds = object_bounds([obj for obj, _ in shown], projection, size, labelled=labelled)
    cut, _ = clip_bounds(bounds, size)
    sides, origins = cut_segments(rectangle_segments(np.rint(bounds)), size)
    sides_at = slices_of(origins // 4, len(shown))
    tags = []
    for index in reversed(np.flatnonzero(~np.isnan(cut[:, 0])).tolist()):
        obj, predicted = shown[index]
        if obj.class_name == DONT_CARE:
            _shade(picture, cut[index])
            continue
        color, seen = box_color(obj, predicted=predicted), tuple(cut[index].tolist())
        own_sides = sides[sides_at[index]]
        if predicted:
            draw_segments(picture, dashes(own_sides, scale), color)
        else:
            draw_segments(picture, own_sides, color, line_width(obj, seen, scale))
        tags.append(Tag(caption_2d(obj), seen, color, predicted))
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
    for index, obj in enumerate(objects):
        if labelled and obj.box_2d is not None:
            left, top, right, bottom = obj.box_2d
            bounds[index] = obj.box_2d if right >= left and bottom >= top else np.nan
        elif obj.cuboid is not None:
            solid.append((index, obj.cuboid))
    if projection is not None and solid:
        projected = projected_bounds(cuboid_corners([cuboid for _, cuboid in solid]), projection)
        bounds[[index for index, _ in solid]], _ = clip_bounds(projected, size)
    return bounds


def projected_bounds(corners: Float64Array, projection: Projection) -> Float64Array:
    """Return (N, 4) bounds of (N, 8, 3) boxes in velo_link, not clipped; NaN for one out of view.

    As boxes.project_corners, and also for edges that the lens bends.
    """
    segments, lines = projection.segments(corners[:, EDGES].reshape(-1, 2, 3))
    owners = lines // len(EDGES)
    bounds = np.full((len(corners), 4), np.nan)
    in_view, first = np.unique(owners, return_index=True)
    if len(in_view):
        bounds[in_view, :2] = np.minimum.reduceat(segments.min(axis=1), first)
        bounds[in_view, 2:] = np.maximum.reduceat(segments.max(axis=1), first)
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


# Drawing of 3D boxes on a camera image: edges and a marked front face.

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
        objects: Labels of the frame.
        projection: Into the picture.
        predictions: Drawn in the style of predictions.
        named: True if boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    shown = objects_to_draw(picture, objects, predictions)
    corners = corners_of(shown)
    size, scale = size_of(picture), scale_of(picture)
    bounds, _ = clip_bounds(projected_bounds(corners, projection), size)
    sides, owners = projection.segments(sides_of(corners[:, _FRONT]).reshape(-1, 2, 3))
    fronts_at = slices_of(owners // len(_FRONT), len(shown))
    segments, lines = projection.segments(corners[:, _WIRES].reshape(-1, 2, 3))
    parts, origins = cut_segments(segments, size)
    wires = lines[origins]
    wires_at = slices_of(wires // len(_WIRES), len(shown))
    tags = []
    for index in reversed(range(len(shown))):
        own_wires = wires_at[index]
        if not len(parts[own_wires]):
            continue
        obj, predicted = shown[index]
        color = box_color(obj, predicted=predicted)
        if not predicted:
            front = sides[fronts_at[index]].reshape(-1, 2)
            tint_polygon(picture, front, color, _FRONT_ALPHA)
        cross = wires[own_wires] % len(_WIRES) >= len(EDGES)
        left, top, right, bottom = bounds[index].tolist()
        seen = None if math.isnan(left) else (left, top, right, bottom)
        edge_width = 1 if predicted else line_width(obj, seen, scale)
        for chosen, width in ((cross, 1), (~cross, edge_width)):
            drawn = parts[own_wires][chosen]
            draw_segments(picture, dashes(drawn, scale) if predicted else drawn, color, width)
        if seen is not None:
            tags.append(Tag(caption_3d(obj), seen, color, predicted))
    if named:
        draw_tags(picture, tags[::-1], TEXT_SCALE * scale)


# Drawing of the objects of a frame on a camera image.


def annotate(
    picture: Pixels,
    objects: Sequence[LabelledObject],
    calibration: Calibration | Projection | None,
    camera: int,
    *,
    predictions: Sequence[LabelledObject] = (),
    solid: bool = True,
    named: bool = True,
) -> None:
    """Draw objects on a camera image: 3D boxes, and 2D boxes of objects without a 3D box.

    Args:
        picture: (H, W, 3) uint8 BGR, drawn on in place.
        objects: Labels of the frame.
        calibration: The frame's, or the result of Projection.of. If it is missing or incomplete,
            2D boxes are drawn if the labels have them for this camera.
        camera: KITTI camera index of the picture.
        predictions: Drawn in the style of predictions.
        solid: True to draw 3D boxes; else 2D boxes only.
        named: True if boxes have tags.

    Raises:
        ValueError: The picture is no writable (H, W, 3) uint8 array.
    """
    projection = projection_of(calibration, camera)
    labelled = is_labelled(calibration, camera)
    if projection is None or not solid:
        draw_boxes_2d(
            picture, objects, projection, predictions=predictions, labelled=labelled, named=named
        )
        return
    flat, flat_predictions = (
        [obj for obj in group if obj.cuboid is None] for group in (objects, predictions)
    )
    draw_boxes_2d(picture, flat, predictions=flat_predictions, labelled=labelled, named=named)
    draw_wireframes(picture, objects, projection, predictions, named=named)


def is_labelled(calibration: Calibration | Projection | None, camera: int) -> bool:
    """Return whether 2D boxes of labels are in pixels of this camera's images."""
    if camera != LABEL_CAMERA:
        return False
    if isinstance(calibration, Projection):
        return calibration.lens is None
    return calibration is None or calibration.rectified


def projection_of(calibration: Calibration | Projection | None, camera: int) -> Projection | None:
    """Return the projection into a camera's images, None for an incomplete calibration."""
    if calibration is None or isinstance(calibration, Projection):
        return calibration
    try:
        return Projection.of(calibration, camera)
    except ValueError:
        return None


# The 2D boxes of objects in a camera image, for viewers that draw them themselves.

_FONT_PX = 12.0
_BLACK: Color = (0, 0, 0)


class StyledBox(NamedTuple):
    """A box with its style; colours are red, green, blue, 0..255.

    Attributes:
        bounds: left, top, right, bottom, pixels; (0, 0) is the centre of the first pixel.
        color: Colour of the lines.
        text: Class, track, score, and the result of the comparison.
        ink, fill: Colours of the text and of its background.
        line_px: Width of the lines.
        font_px: Height of the text.
    """

    bounds: Bounds
    color: Color
    text: str
    ink: Color
    fill: Color
    line_px: float
    font_px: float


def image_boxes(
    objects: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    calibration: Calibration | None,
    camera: int,
    size: tuple[int, int],
) -> list[StyledBox]:
    """Return the boxes in a camera's images, by descending distance.

    In the labelled camera they are those of the labels, unchanged; in others, and for objects
    without a 2D box, the bounds of the projected 3D box, clipped to the image. Objects out of view,
    or of an incomplete calibration, have none.

    Args:
        objects: Labels of the frame.
        predictions: Drawn in the style of predictions.
        calibration: Calibration of the frame.
        camera: KITTI index of the camera.
        size: (width, height) of the image.
    """
    drawn = [(obj, False) for obj in objects] + [(obj, True) for obj in predictions]
    drawn.sort(key=lambda pair: -distance_of(pair[0]))
    projection = projection_of(calibration, camera)
    labelled = is_labelled(calibration, camera)
    bounds = object_bounds([obj for obj, _ in drawn], projection, size, labelled=labelled)
    scale = scale_for(size)
    return [
        _style(obj, four, scale, predicted=predicted)
        for (obj, predicted), four in zip(drawn, bounds, strict=True)
        if np.isfinite(four).all()
    ]


def _style(obj: LabelledObject, four: np.ndarray, scale: float, *, predicted: bool) -> StyledBox:
    left, top, right, bottom = four.tolist()
    bounds = left, top, right, bottom
    color = box_color(obj, predicted=predicted)
    if obj.class_name == DONT_CARE and not predicted:
        color = NEUTRAL_COLOR[::-1]
    ink, fill = (color, _BLACK) if predicted else (ink_for(color), color)
    return StyledBox(
        bounds,
        color[::-1],
        name_of(obj),
        ink[::-1],
        fill[::-1],
        line_width(obj, bounds, scale),
        _FONT_PX * scale,
    )
