# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes and points drawn on a camera image of any size, from above, and in perspective.

Each raises MissingDataError if required data is missing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import cv2
import numpy as np

from ..drawing.annotate import is_labelled
from ..drawing.birds_eye import birds_eye
from ..drawing.boxes_2d import draw_boxes_2d
from ..drawing.objects import resized
from ..drawing.perspective import draw_perspective
from ..drawing.points import draw_points
from ..drawing.wireframes import draw_wireframes
from ..options.pictures import ColorBy
from .frame_parts import (
    bird_points,
    frame_points,
    frame_projection,
    needed_projection,
    of_classes,
    point_colors,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..drawing.pixels import Pixels
    from ..drawing.projection import Projection
    from ..options.pictures import PictureOptions
    from .frame import FrameData


class Shown(NamedTuple):
    """A camera's image, scaled."""

    camera: int
    picture: Pixels
    scale_x: float = 1.0
    scale_y: float = 1.0

    def projection(self, frame: FrameData) -> Projection:
        """Return the projection from velo_link into the picture."""
        return frame_projection(frame, self.camera).resized(self.scale_x, self.scale_y)


def fit_image(camera: int, image: Pixels, size: tuple[int, int]) -> Shown:
    """Scale a camera's image to fit a (width, height), pixels."""
    scale = min(size[0] / image.shape[1], size[1] / image.shape[0])
    width, height = (max(round(side * scale), 1) for side in image.shape[1::-1])
    # Down to half the size, linear interpolation still uses every pixel, at a fifth of the cost of
    # area averaging.
    interpolation = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(image, (width, height), interpolation=interpolation), np.uint8)
    return Shown(camera, picture, width / image.shape[1], height / image.shape[0])


Painter: TypeAlias = 'Callable[[Pixels, Shown, FrameData, PictureOptions], None]'
"""Draws on a picture that shows a camera's image."""


def paint_boxes_2d(window: Pixels, shown: Shown, frame: FrameData, options: PictureOptions) -> None:
    """Draw 2D boxes."""
    scales = shown.scale_x, shown.scale_y
    projection = needed_projection(frame, shown.camera)
    draw_boxes_2d(
        window,
        resized(frame.objects, *scales),
        projection.resized(*scales) if projection else None,
        predictions=resized(frame.predictions, *scales),
        labelled=is_labelled(frame.calibration, shown.camera),
        named=options.named,
    )


def paint_boxes_3d(window: Pixels, shown: Shown, frame: FrameData, options: PictureOptions) -> None:
    """Draw 3D wireframes."""
    projection = shown.projection(frame)
    draw_wireframes(window, frame.objects, projection, frame.predictions, named=options.named)


def paint_scan(window: Pixels, shown: Shown, frame: FrameData, options: PictureOptions) -> None:
    """Draw the scan."""
    points, projection = frame_points(frame), shown.projection(frame)
    colors = point_colors(frame, options, ColorBy.DEPTH)
    draw_points(window, points, projection, colors, options.point_size)


def draw_from_behind(frame: FrameData, options: PictureOptions) -> Pixels:
    """Draw the scan and the boxes in perspective."""
    frame = of_classes(frame, options)
    return draw_perspective(
        bird_points(frame),
        frame.objects,
        frame.predictions,
        point_colors(frame, options, ColorBy.HEIGHT),
        options.point_size,
        named=options.named,
    )


def draw_bird(frame: FrameData, options: PictureOptions) -> Pixels:
    """Draw the scan and the boxes from above."""
    frame = of_classes(frame, options)
    return birds_eye(
        bird_points(frame),
        frame.objects,
        frame.predictions,
        options.bird,
        point_colors(frame, options, ColorBy.HEIGHT),
        named=options.named,
    )
