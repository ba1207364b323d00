# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes and points drawn on a camera image of any size, from above, and in perspective.

All functions raise MissingDataError if required data is missing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import cv2
import numpy as np

from ..drawing.annotate import draw_boxes_2d, draw_wireframes, is_labelled
from ..drawing.birds_eye import SIZE, birds_eye, draw_perspective
from ..drawing.labelled_objects import LABEL_CAMERA, compared, objects_of, resized
from ..drawing.points import PointColors, draw_points
from ..drawing.projection import Projection
from ..model.boxes import DONT_CARE
from ..model.classes import KITTI_OVERLAPS, LeastOverlaps
from ..model.errors import KittiRos2Error, MissingDataError, describe_error
from ..model.streams import Stream
from ..options.outputs import ColorBy
from .recording_frames import POINT_LABELS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from ..drawing.labelled_objects import Pixels
    from ..model.samples import Float32Array, FrameLabels
    from ..options.outputs import PictureOptions
    from .recording_frames import FrameData


# Access to the parts of a frame for drawing, with an error for a missing part.

_CALIBRATION = Stream.CALIBRATION.value


def chosen_camera(
    cameras: Collection[int], options: PictureOptions, main: int = LABEL_CAMERA
) -> int | None:
    """Return the requested camera; else the main one, or the first; None without any."""
    if options.camera is not None:
        return options.camera
    return main if main in cameras else min(cameras, default=None)


def camera_image(frame: FrameData, options: PictureOptions) -> tuple[int, Pixels]:
    """Return the camera that the options choose, and its image, read-only.

    Raises:
        MissingDataError: The frame has no image of it.
    """
    camera = chosen_camera(frame.images, options)
    if camera is None:
        raise _missing(frame, 'image', 'image_')
    if camera not in frame.images:
        raise _missing(frame, f'image of camera {camera}', f'image_{camera}')
    return camera, frame.images[camera]


def frame_points(frame: FrameData) -> Float32Array:
    """Return the scan.

    Raises:
        MissingDataError: The frame has no scan.
    """
    if frame.points is None:
        raise _missing(frame, 'scan', Stream.SCAN.value)
    return frame.points


def bird_points(frame: FrameData) -> Float32Array | None:
    """Return the scan for the bird's-eye view; None if the frame only has boxes.

    Raises:
        MissingDataError: The frame has neither.
    """
    boxes = any(obj.cuboid for obj in (*frame.objects, *frame.predictions))
    return frame.points if boxes else frame_points(frame)


def point_colors(frame: FrameData, options: PictureOptions, default: ColorBy) -> PointColors:
    """Return the colours of points that the options choose.

    Raises:
        MissingDataError: They are those of classes, and the points have no labels.
    """
    by = options.color_by or default
    if by is ColorBy.SEMANTIC and frame.points is not None and frame.point_labels is None:
        if POINT_LABELS in frame.missing:
            raise _missing(frame, 'labels of points', POINT_LABELS)
        raise _missing(frame, "labels of points: semantic takes SemanticKITTI's, NNNNNN.label", '-')
    return PointColors(by, options.color_map, frame.point_labels)


def frame_projection(frame: FrameData, camera: int) -> Projection:
    """Return the projection from velo_link into the images of a camera.

    Raises:
        MissingDataError: The calibration is missing or incomplete.
    """
    if frame.calibration is None:
        raise _missing(frame, 'calibration', _CALIBRATION)
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
    needed = any(obj.cuboid and not (labelled and obj.box_2d) for obj in everything)
    return frame_projection(frame, camera) if needed else None


def of_classes(frame: FrameData, options: PictureOptions) -> FrameData:
    """Return the frame with objects of the selected classes only, and DontCare regions.

    Classes are compared without regard to case.
    """
    if not options.classes:
        return frame
    selected = {kind.lower() for kind in (*options.classes, DONT_CARE)}
    return replace(
        frame,
        objects=[obj for obj in frame.objects if obj.class_name.lower() in selected],
        predictions=[obj for obj in frame.predictions if obj.class_name.lower() in selected],
    )


def _missing(frame: FrameData, part: str, stream: str) -> MissingDataError:
    """Make the error for a missing part of a frame, with the reason if known."""
    reason = _reason(frame, stream)
    return MissingDataError(f'{name_of(frame)}: no {part}' + (f': {reason}' if reason else ''))


def _reason(frame: FrameData, stream: str) -> str:
    """Return the reason for a missing stream, '' if unknown."""
    return next((why for name, why in frame.missing.items() if name.startswith(stream)), '')


def name_of(frame: FrameData) -> str:
    """Return the name of the frame in errors."""
    return f'{frame.source}: frame {frame.number}'


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


def draw_from_behind(
    frame: FrameData, options: PictureOptions, size: tuple[int, int] = SIZE
) -> Pixels:
    """Draw the scan and the boxes in perspective, (width, height) pixels."""
    frame = of_classes(frame, options)
    return draw_perspective(
        bird_points(frame),
        frame.objects,
        frame.predictions,
        point_colors(frame, options, ColorBy.HEIGHT),
        options.point_size,
        named=options.named,
        size=size,
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


# Predictions of frames, compared with labels.

_NAME = Stream.PREDICTIONS.value


@dataclass(frozen=True)
class Predictions:
    """The predictions of one recording.

    Attributes:
        read: Returns the predictions of a frame, such as ResultFiles.read; raises KittiRos2Error
            or OSError if they cannot be read.
        overlaps: The IoU above which a prediction is a true positive.
    """

    read: Callable[[int], FrameLabels]
    overlaps: LeastOverlaps = KITTI_OVERLAPS

    def add_to(self, frame: FrameData) -> FrameData:
        """Return the frame with its predictions, compared with its labels if it has any.

        Bad lines are in its missing.
        """
        try:
            labels = self.read(frame.number)
        except (KittiRos2Error, OSError) as error:
            return replace(frame, missing={**frame.missing, _NAME: describe_error(error)})
        missing = {f'{_NAME} {row}': reason for row, reason in labels.missing.items()}
        predictions = objects_of(labels, frame.calibration)
        objects = frame.objects
        if frame.labelled:
            objects, predictions = compared(objects, predictions, self.overlaps)
        return replace(
            frame,
            objects=objects,
            predictions=predictions,
            missing={**frame.missing, **missing},
        )
