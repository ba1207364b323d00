# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of the objects of a frame on a camera image."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .boxes_2d import draw_boxes_2d
from .objects import LABEL_CAMERA
from .projection import Projection
from .wireframes import draw_wireframes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.samples import Calibration
    from .objects import LabelledObject
    from .pixels import Pixels


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
        objects: Of the frame.
        calibration: Of the frame, or the result of Projection.of. If it is missing or incomplete,
            2D boxes are drawn if the labels have them for this camera.
        camera: KITTI camera index of the picture.
        predictions: In their own style.
        solid: Whether 3D boxes are drawn; else 2D boxes only.
        named: Whether boxes have tags.

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
        [each for each in some if each.cuboid is None] for some in (objects, predictions)
    )
    draw_boxes_2d(picture, flat, predictions=flat_predictions, labelled=labelled, named=named)
    draw_wireframes(picture, objects, projection, predictions, named=named)


def is_labelled(calibration: Calibration | Projection | None, camera: int) -> bool:
    """Whether 2D boxes of labels are in pixels of this camera's images."""
    if camera != LABEL_CAMERA:
        return False
    if isinstance(calibration, Projection):
        return calibration.d is None
    return calibration is None or calibration.rectified


def projection_of(calibration: Calibration | Projection | None, camera: int) -> Projection | None:
    """Return the projection into a camera's images, None for an incomplete calibration."""
    if calibration is None or isinstance(calibration, Projection):
        return calibration
    try:
        return Projection.of(calibration, camera)
    except ValueError:
        return None
