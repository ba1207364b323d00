# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The 2D boxes of objects in a camera image, for outlets that draw them on their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import DONT_CARE
from .annotate import is_labelled, projection_of
from .boxes_2d import object_bounds
from .looks import box_color, line_width, scale_for
from .objects import distance_of, name_of
from .palette import NEUTRAL_COLOR
from .text import ink_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.samples import Calibration
    from .objects import LabelledObject
    from .strokes import Bounds, Color

_FONT_PX = 12.0
_BLACK: Color = (0, 0, 0)


class StyledBox(NamedTuple):
    """A box with its looks; colours are red, green, blue, 0..255.

    Attributes:
        bounds: left, top, right, bottom, pixels; (0, 0) is the centre of the first pixel.
        color: Of the lines.
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
        calibration: Of the frame.
        camera: KITTI index of the camera.
        size: (width, height) of the image.
    """
    both = [(each, False) for each in objects] + [(each, True) for each in predictions]
    both.sort(key=lambda pair: -distance_of(pair[0]))
    projection = projection_of(calibration, camera)
    labelled = is_labelled(calibration, camera)
    bounds = object_bounds([each for each, _ in both], projection, size, labelled=labelled)
    scale = scale_for(size)
    return [
        _look(each, four, scale, predicted=predicted)
        for (each, predicted), four in zip(both, bounds, strict=True)
        if np.isfinite(four).all()
    ]


def _look(each: LabelledObject, four: np.ndarray, scale: float, *, predicted: bool) -> StyledBox:
    left, top, right, bottom = four.tolist()
    bounds = left, top, right, bottom
    color = box_color(each, predicted=predicted)
    if each.class_name == DONT_CARE and not predicted:
        color = NEUTRAL_COLOR[::-1]
    ink, fill = (color, _BLACK) if predicted else (ink_for(color), color)
    return StyledBox(
        bounds,
        color[::-1],
        name_of(each),
        ink[::-1],
        fill[::-1],
        line_width(each, bounds, scale),
        _FONT_PX * scale,
    )
