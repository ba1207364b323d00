# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Access to the parts of a frame for drawing, with an error for a missing part."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..drawing.annotate import is_labelled
from ..drawing.objects import LABEL_CAMERA
from ..drawing.point_colors import PointColors
from ..drawing.projection import Projection
from ..model.boxes import DONT_CARE
from ..model.errors import MissingDataError
from ..model.streams import Stream
from ..options.pictures import ColorBy
from .frame import POINT_LABELS

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..drawing.pixels import Pixels
    from ..model.samples import Float32Array
    from ..options.pictures import PictureOptions
    from .frame import FrameData

_CALIBRATION = Stream.CALIBRATION.value


def chosen_camera(cameras: Collection[int], options: PictureOptions) -> int | None:
    """Return the requested camera; else camera 2, or the first one; None without any."""
    if options.camera is not None:
        return options.camera
    return LABEL_CAMERA if LABEL_CAMERA in cameras else min(cameras, default=None)


def camera_image(frame: FrameData, options: PictureOptions) -> tuple[int, Pixels]:
    """Return the camera that the options choose, and its image, read-only.

    Raises:
        MissingDataError: The frame has no image of it.
    """
    camera = chosen_camera(frame.images, options)
    if camera is None:
        raise _lacking(frame, 'image', 'image_')
    if camera not in frame.images:
        raise _lacking(frame, f'image of camera {camera}', f'image_{camera}')
    return camera, frame.images[camera]


def frame_points(frame: FrameData) -> Float32Array:
    """Return the scan.

    Raises:
        MissingDataError: The frame has no scan.
    """
    if frame.points is None:
        raise _lacking(frame, 'scan', Stream.SCAN.value)
    return frame.points


def bird_points(frame: FrameData) -> Float32Array | None:
    """Return the scan for the bird's-eye view; None if the frame only has boxes.

    Raises:
        MissingDataError: The frame has neither.
    """
    boxes = any(each.cuboid for each in (*frame.objects, *frame.predictions))
    return frame.points if boxes else frame_points(frame)


def point_colors(frame: FrameData, options: PictureOptions, default: ColorBy) -> PointColors:
    """Return the colours of points that the options choose.

    Raises:
        MissingDataError: They are those of classes, and the points have no labels.
    """
    by = options.color_by or default
    if by is ColorBy.SEMANTIC and frame.points is not None and frame.point_labels is None:
        if POINT_LABELS in frame.missing:
            raise _lacking(frame, 'labels of points', POINT_LABELS)
        raise _lacking(frame, "labels of points: semantic takes SemanticKITTI's, NNNNNN.label", '-')
    return PointColors(by, options.color_map, frame.point_labels)


def frame_projection(frame: FrameData, camera: int) -> Projection:
    """Return the projection from velo_link into the images of a camera.

    Raises:
        MissingDataError: The calibration is missing or incomplete.
    """
    if frame.calibration is None:
        raise _lacking(frame, 'calibration', _CALIBRATION)
    try:
        return Projection.of(frame.calibration, camera)
    except ValueError as error:
        reason = _reason(frame, _CALIBRATION) or error
        raise MissingDataError(f'{name_of(frame)}: {reason}') from None


def needed_projection(frame: FrameData, camera: int) -> Projection | None:
    """Return the projection if 2D boxes cannot be drawn without it; else None.

    Raises:
        MissingDataError: It is needed, and the calibration is missing or incomplete.
    """
    labelled = is_labelled(frame.calibration, camera)
    everything = (*frame.objects, *frame.predictions)
    needed = any(each.cuboid and not (labelled and each.box_2d) for each in everything)
    return frame_projection(frame, camera) if needed else None


def of_classes(frame: FrameData, options: PictureOptions) -> FrameData:
    """Return the frame with objects of the selected classes only, and DontCare regions.

    Classes are compared without regard to case.
    """
    if not options.classes:
        return frame
    kept = {kind.lower() for kind in (*options.classes, DONT_CARE)}
    return replace(
        frame,
        objects=[each for each in frame.objects if each.class_name.lower() in kept],
        predictions=[each for each in frame.predictions if each.class_name.lower() in kept],
    )


def _lacking(frame: FrameData, what: str, stream: str) -> MissingDataError:
    """Make the error for a missing part of a frame, with the reason if it is known."""
    reason = _reason(frame, stream)
    return MissingDataError(f'{name_of(frame)}: no {what}' + (f': {reason}' if reason else ''))


def _reason(frame: FrameData, stream: str) -> str:
    """Return the reason why a stream is missing, '' if unknown."""
    return next((why for name, why in frame.missing.items() if name.startswith(stream)), '')


def name_of(frame: FrameData) -> str:
    """Return the name of the frame in errors."""
    return f'{frame.source}: frame {frame.number}'
