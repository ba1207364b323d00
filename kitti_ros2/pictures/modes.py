# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of picture modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..drawing.annotate import is_labelled
from ..drawing.birds_eye import birds_eye
from ..drawing.boxes_2d import draw_boxes_2d
from ..drawing.points import draw_points
from ..drawing.wireframes import draw_wireframes
from ..model.streams import Stream
from .frame_parts import (
    bird_points,
    camera_image,
    chosen_camera,
    frame_points,
    frame_projection,
    needed_projection,
    of_classes,
)
from .panel import draw_panel

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from ..drawing.pixels import Pixels
    from ..options.pictures import PictureOptions
    from .frame import Frame


@dataclass(frozen=True)
class Mode:
    """One kind of picture.

    Attributes:
        draw: Draws it from a frame; raises MissingDataError if required data is missing.
        image: Whether it shows a camera image.
        others: The other streams that it shows.
    """

    draw: Callable[[Frame, PictureOptions], Pixels]
    image: bool
    others: frozenset[str]

    def streams(self, cameras: Collection[int], options: PictureOptions) -> frozenset[str]:
        """Return the streams that FrameSource.frame has to read.

        Args:
            cameras: Cameras whose images the source has.
            options: Picture options.
        """
        camera = chosen_camera(cameras, options) if self.image else None
        return self.others if camera is None else self.others | {f'image_{camera}'}


def draw_camera(frame: Frame, options: PictureOptions) -> Pixels:
    """Draw 2D boxes on the camera image."""
    camera, image = camera_image(frame, options)
    frame = of_classes(frame, options)
    labelled = is_labelled(frame.calibration, camera)
    projection = needed_projection(frame, camera)
    picture: Pixels = image.copy()
    draw_boxes_2d(
        picture,
        frame.objects,
        projection,
        predictions=frame.predictions,
        labelled=labelled,
        named=options.named,
    )
    return picture


def draw_boxes(frame: Frame, options: PictureOptions) -> Pixels:
    """Draw 3D wireframes on the camera image."""
    camera, image = camera_image(frame, options)
    projection = frame_projection(frame, camera)
    frame = of_classes(frame, options)
    picture: Pixels = image.copy()
    draw_wireframes(picture, frame.objects, projection, frame.predictions, named=options.named)
    return picture


def draw_lidar(frame: Frame, options: PictureOptions) -> Pixels:
    """Draw the scan on the camera image."""
    camera, image = camera_image(frame, options)
    points, projection = frame_points(frame), frame_projection(frame, camera)
    picture: Pixels = image.copy()
    draw_points(
        picture, points, projection, options.color_by, options.color_map, options.point_size
    )
    return picture


def draw_bev(frame: Frame, options: PictureOptions) -> Pixels:
    """Draw the scan and the boxes from above."""
    frame = of_classes(frame, options)
    points = bird_points(frame)
    return birds_eye(
        points,
        frame.objects,
        frame.predictions,
        options.bird,
        options.color_map,
        named=options.named,
    )


_LABELS = frozenset({Stream.LABELS.value})
_SCAN = frozenset({Stream.SCAN.value})
_MOTION = frozenset({Stream.OXTS.value, Stream.POSE.value})

MODES: Mapping[str, Mode] = {
    'camera': Mode(draw_camera, image=True, others=_LABELS),
    'boxes': Mode(draw_boxes, image=True, others=_LABELS),
    'lidar': Mode(draw_lidar, image=True, others=_SCAN),
    'bev': Mode(draw_bev, image=False, others=_SCAN | _LABELS),
    'panel': Mode(draw_panel, image=True, others=_SCAN | _LABELS | _MOTION),
}
