# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of picture modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.streams import Stream
from .frame_parts import camera_image, chosen_camera, of_classes
from .painters import Shown, draw_bird, draw_from_behind, paint_boxes_2d, paint_boxes_3d, paint_scan
from .panel import draw_panel

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from ..drawing.pixels import Pixels
    from ..options.pictures import PictureOptions
    from .frame import FrameData
    from .painters import Painter


@dataclass(frozen=True)
class Mode:
    """One kind of picture.

    Attributes:
        draw: Draws it from a frame; raises MissingDataError if required data is missing.
        image: Whether it shows a camera image.
        others: The other streams that it shows.
        instead: Streams that it shows if there are no images.
    """

    draw: Callable[[FrameData, PictureOptions], Pixels]
    image: bool
    others: frozenset[str]
    instead: frozenset[str] = frozenset()

    def streams(self, cameras: Collection[int], options: PictureOptions) -> frozenset[str]:
        """Return the streams that FrameSource.frame has to read.

        Args:
            cameras: Cameras whose images the source has.
            options: Picture options.
        """
        camera = chosen_camera(cameras, options) if self.image else None
        return self.others | (self.instead if camera is None else {f'image_{camera}'})


def _on_image(paint: Painter) -> Callable[[FrameData, PictureOptions], Pixels]:
    """Return a function that paints on a copy of the camera image."""

    def draw(frame: FrameData, options: PictureOptions) -> Pixels:
        camera, image = camera_image(frame, options)
        picture: Pixels = image.copy()
        paint(picture, Shown(camera, picture), of_classes(frame, options), options)
        return picture

    return draw


_LABELS = frozenset({Stream.LABELS.value})
_SCAN = frozenset({Stream.SCAN.value})
_MOTION = frozenset({Stream.OXTS.value, Stream.POSE.value})
_PATH = frozenset({Stream.PATH.value})

MODES: Mapping[str, Mode] = {
    'camera': Mode(_on_image(paint_boxes_2d), image=True, others=_LABELS),
    'boxes': Mode(_on_image(paint_boxes_3d), image=True, others=_LABELS),
    'lidar': Mode(_on_image(paint_scan), image=True, others=_SCAN),
    'bev': Mode(draw_bird, image=False, others=_SCAN | _LABELS),
    'perspective': Mode(draw_from_behind, image=False, others=_SCAN | _LABELS),
    'panel': Mode(draw_panel, image=True, others=_SCAN | _LABELS | _MOTION, instead=_PATH),
}
