# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures that can be made of a frame: a table of modes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..boxes import DONT_CARE
from ..drawing.annotate import is_labelled
from ..drawing.birds_eye import birds_eye
from ..drawing.boxes_2d import draw_boxes_2d
from ..drawing.objects import LABEL_CAMERA
from ..drawing.points import draw_points
from ..drawing.projection import Projection
from ..drawing.wireframes import draw_wireframes
from ..errors import LackingError
from ..samples import Stream

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping

    from ..drawing.pixels import Pixels
    from ..options import PictureOptions
    from ..samples import Float32Array
    from .frame import Frame


@dataclass(frozen=True)
class Mode:
    """One kind of picture.

    Attributes:
        draw: Makes it of a frame; raises LackingError where the frame has not what it takes.
        image: Whether it shows a camera's image.
        others: The streams that it shows besides.
    """

    draw: Callable[[Frame, PictureOptions], Pixels]
    image: bool
    others: frozenset[str]

    def streams(self, cameras: Collection[int], options: PictureOptions) -> frozenset[str]:
        """What FrameSource.frame is to read.

        Args:
            cameras: Those that the source has images of.
            options: Of the picture.
        """
        camera = chosen_camera(cameras, options) if self.image else None
        return self.others if camera is None else self.others | {f'image_{camera}'}


def chosen_camera(cameras: Collection[int], options: PictureOptions) -> int | None:
    """The camera that is asked for; else camera 2, or the first there is; None without any."""
    if options.camera is not None:
        return options.camera
    return LABEL_CAMERA if LABEL_CAMERA in cameras else min(cameras, default=None)


def camera_image(frame: Frame, options: PictureOptions) -> tuple[int, Pixels]:
    """The camera that the options choose, and its image, not to be drawn on.

    Raises:
        LackingError: The frame has no image of it.
    """
    camera = chosen_camera(frame.images, options)
    if camera is None:
        raise _lacking(frame, 'an image', 'image_')
    if camera not in frame.images:
        raise _lacking(frame, f'an image of camera {camera}', f'image_{camera}')
    return camera, frame.images[camera]


def frame_points(frame: Frame) -> Float32Array:
    """The scan.

    Raises:
        LackingError: The frame has none.
    """
    if frame.points is None:
        raise _lacking(frame, 'a scan', Stream.SCAN.value)
    return frame.points


def frame_projection(frame: Frame, camera: int) -> Projection:
    """velo_link into the images of a camera.

    Raises:
        LackingError: The calibration is not there or not whole.
    """
    if frame.calibration is None:
        raise _lacking(frame, 'a calibration', Stream.CALIBRATION.value)
    try:
        return Projection.of(frame.calibration, camera)
    except ValueError as error:
        raise LackingError(f'{_name(frame)}: {error}') from None


def of_classes(frame: Frame, options: PictureOptions) -> Frame:
    """The frame with the objects of the classes that are drawn; DontCare regions always are."""
    if not options.classes:
        return frame
    kept = {*options.classes, DONT_CARE}
    return replace(
        frame,
        objects=[each for each in frame.objects if each.kind in kept],
        predictions=[each for each in frame.predictions if each.kind in kept],
    )


def draw_camera(frame: Frame, options: PictureOptions) -> Pixels:
    """2D boxes on the camera image."""
    camera, image = camera_image(frame, options)
    frame = of_classes(frame, options)
    labelled = is_labelled(frame.calibration, camera)
    projection = None
    if any(
        each.cuboid and not (labelled and each.box_2d)
        for each in (*frame.objects, *frame.predictions)
    ):
        projection = frame_projection(frame, camera)
    picture: Pixels = image.copy()
    draw_boxes_2d(
        picture, frame.objects, projection, predictions=frame.predictions, labelled=labelled
    )
    return picture


def draw_boxes(frame: Frame, options: PictureOptions) -> Pixels:
    """3D wireframes on the camera image."""
    camera, image = camera_image(frame, options)
    projection = frame_projection(frame, camera)
    frame = of_classes(frame, options)
    picture: Pixels = image.copy()
    draw_wireframes(picture, frame.objects, projection, frame.predictions)
    return picture


def draw_lidar(frame: Frame, options: PictureOptions) -> Pixels:
    """The scan on the camera image."""
    camera, image = camera_image(frame, options)
    points, projection = frame_points(frame), frame_projection(frame, camera)
    picture: Pixels = image.copy()
    draw_points(
        picture, points, projection, options.color_by, options.color_map, options.point_size
    )
    return picture


def draw_bev(frame: Frame, options: PictureOptions) -> Pixels:
    """The scan and the boxes from above."""
    frame = of_classes(frame, options)
    boxes = any(each.cuboid for each in (*frame.objects, *frame.predictions))
    points = frame.points if boxes else frame_points(frame)
    return birds_eye(points, frame.objects, frame.predictions, options.bird, options.color_map)


def _lacking(frame: Frame, what: str, stream: str) -> LackingError:
    """The error that a frame has not what a picture shows, with the reason where one is known."""
    reasons = [reason for name, reason in frame.lacks.items() if name.startswith(stream)]
    return LackingError(f'{_name(frame)} lacks {what}' + (f': {reasons[0]}' if reasons else ''))


def _name(frame: Frame) -> str:
    return f'{frame.source}: frame {frame.number}'


_LABELS = frozenset({Stream.LABELS.value})
_SCAN = frozenset({Stream.SCAN.value})

MODES: Mapping[str, Mode] = {
    'camera': Mode(draw_camera, image=True, others=_LABELS),
    'boxes': Mode(draw_boxes, image=True, others=_LABELS),
    'lidar': Mode(draw_lidar, image=True, others=_SCAN),
    'bev': Mode(draw_bev, image=False, others=_SCAN | _LABELS),
}
