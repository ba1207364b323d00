# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The parts of a frame that pictures are made of, or the error that says which one is missing."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..drawing.annotate import is_labelled
from ..drawing.objects import LABEL_CAMERA
from ..drawing.projection import Projection
from ..model.boxes import DONT_CARE
from ..model.errors import MissingDataError
from ..model.streams import Stream

if TYPE_CHECKING:
    from collections.abc import Collection

    from ..drawing.pixels import Pixels
    from ..model.samples import Float32Array
    from ..options.pictures import PictureOptions
    from .frame import Frame


_CALIBRATION = Stream.CALIBRATION.value


def chosen_camera(cameras: Collection[int], options: PictureOptions) -> int | None:
    """The camera that is asked for; else camera 2, or the first there is; None without any."""
    if options.camera is not None:
        return options.camera
    return LABEL_CAMERA if LABEL_CAMERA in cameras else min(cameras, default=None)


def camera_image(frame: Frame, options: PictureOptions) -> tuple[int, Pixels]:
    """The camera that the options choose, and its image, not to be drawn on.

    Raises:
        MissingDataError: The frame has no image of it.
    """
    camera = chosen_camera(frame.images, options)
    if camera is None:
        raise _lacking(frame, 'image', 'image_')
    if camera not in frame.images:
        raise _lacking(frame, f'image of camera {camera}', f'image_{camera}')
    return camera, frame.images[camera]


def frame_points(frame: Frame) -> Float32Array:
    """The scan.

    Raises:
        MissingDataError: The frame has none.
    """
    if frame.points is None:
        raise _lacking(frame, 'scan', Stream.SCAN.value)
    return frame.points


def bird_points(frame: Frame) -> Float32Array | None:
    """The scan; None where there is none, but boxes to be seen from above.

    Raises:
        MissingDataError: There is neither.
    """
    boxes = any(each.cuboid for each in (*frame.objects, *frame.predictions))
    return frame.points if boxes else frame_points(frame)


def frame_projection(frame: Frame, camera: int) -> Projection:
    """velo_link into the images of a camera.

    Raises:
        MissingDataError: The calibration is not there or not whole.
    """
    if frame.calibration is None:
        raise _lacking(frame, 'calibration', _CALIBRATION)
    try:
        return Projection.of(frame.calibration, camera)
    except ValueError as error:
        reason = _reason(frame, _CALIBRATION) or error
        raise MissingDataError(f'{name_of(frame)}: {reason}') from None


def needed_projection(frame: Frame, camera: int) -> Projection | None:
    """The same, where 2D boxes cannot be drawn without; else None.

    Raises:
        MissingDataError: It is needed, and the calibration is not there or not whole.
    """
    labelled = is_labelled(frame.calibration, camera)
    everything = (*frame.objects, *frame.predictions)
    needed = any(each.cuboid and not (labelled and each.box_2d) for each in everything)
    return frame_projection(frame, camera) if needed else None


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


def _lacking(frame: Frame, what: str, stream: str) -> MissingDataError:
    """The error that a frame has not what a picture shows, with the reason where one is known."""
    reason = _reason(frame, stream)
    return MissingDataError(f'{name_of(frame)}: no {what}' + (f': {reason}' if reason else ''))


def _reason(frame: Frame, stream: str) -> str:
    """Why a stream cannot be had, '' where that is not known."""
    return next((why for name, why in frame.missing.items() if name.startswith(stream)), '')


def name_of(frame: Frame) -> str:
    """The frame in an error's words."""
    return f'{frame.source}: frame {frame.number}'
