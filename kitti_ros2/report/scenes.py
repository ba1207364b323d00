# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a few frames of a recording."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..model.boxes import DONT_CARE
from ..model.errors import MissingDataError
from ..model.streams import Stream
from ..model.text import format_count
from ..options.pictures import PictureOptions
from ..pictures.frame_parts import chosen_camera
from ..pictures.modes import MODES
from ..pictures.output import encode_picture
from .contents import ReportPicture, Scene
from .statistics import spread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ..pictures.frame import FrameData, FrameSource

_QUALITY = 80
_MOST_WIDTH = 1920
_MOST_CAMERAS = 4


def draw_scenes(
    source: FrameSource,
    pictured: Sequence[int],
    most: int,
    seen: Callable[[FrameData], None],
    step: Callable[[], None],
) -> tuple[Scene, ...]:
    """Draw evenly spread frames: the camera image, points in it, and from above.

    Args:
        source: The frames.
        pictured: Numbers of the frames with images or scans.
        most: Maximum number of frames.
        seen: Called with each frame.
        step: Called after each frame.
    """
    options = PictureOptions()
    camera = chosen_camera(source.cameras, options)
    wanted = frozenset[str]().union(
        *(MODES[name].streams(source.cameras, options) for name in ('boxes', 'lidar', 'bev'))
    )
    scenes = []
    for place in spread(len(pictured), most):
        frame = source.frame(pictured[place], wanted)
        seen(frame)
        scene = _scene(frame, source, camera)
        if scene.camera or scene.points or scene.above:
            scenes.append(scene)
        step()
    return tuple(scenes)


def draw_projections(
    source: FrameSource,
    pictured: Sequence[int],
    scenes: Sequence[Scene],
    seen: Callable[[FrameData], None],
) -> tuple[ReportPicture, ...]:
    """Draw the points of the middle frame over the image of each camera.

    Args:
        source: The frames.
        pictured: Numbers of the frames with images or scans.
        scenes: The pictures of some frames, used again if the middle frame is among them.
        seen: Called with the frame.
    """
    if not pictured:
        return ()
    middle = pictured[len(pictured) // 2]
    points = next((scene.points for scene in scenes if scene.number == middle), None)
    drawn = {} if points is None else {chosen_camera(source.cameras, PictureOptions()): points}
    cameras = sorted(source.cameras)[:_MOST_CAMERAS]
    images = [Stream(f'image_{index}').value for index in cameras if index not in drawn]
    frame = source.frame(middle, frozenset({Stream.SCAN.value, *images}))
    seen(frame)
    found = (
        drawn.get(index) or _projection(frame, index, source.cameras[index])
        for index in cameras
        if index in drawn or index in frame.images
    )
    return tuple(picture for picture in found if picture is not None)


def _scene(frame: FrameData, source: FrameSource, camera: int | None) -> Scene:
    """Draw the possible pictures of a frame."""
    image = points = None
    if camera is not None:
        image = _image(frame, camera, source.cameras[camera])
        points = _projection(frame, camera, source.cameras[camera])
    return Scene(
        frame.number, frame.stamp_ns, tuple(_words(frame)), image, points, _from_above(frame)
    )


def _image(frame: FrameData, camera: int, name: str) -> ReportPicture | None:
    """Draw the image with 3D boxes, or with 2D boxes without a calibration."""
    alt = f'Image of camera {name}, frame {frame.number}, with {_labels(frame)}'
    drawn = (_picture(mode, frame, camera, alt, f'Camera {name}') for mode in ('boxes', 'camera'))
    return next(filter(None, drawn), None)


def _from_above(frame: FrameData) -> ReportPicture | None:
    alt = f'Points of the scanner from above, frame {frame.number}, with {_labels(frame)}'
    return _picture('bev', frame, None, alt, 'From above, by height')


def _projection(frame: FrameData, camera: int, name: str) -> ReportPicture | None:
    """Draw points over an image."""
    alt = f'Points of the scanner over the image of camera {name}, frame {frame.number}'
    caption = f'Points in camera {name}, by depth'
    return _picture('lidar', frame, camera, alt, caption)


def _words(frame: FrameData) -> Iterator[str]:
    counts = Counter(each.class_name for each in frame.objects if each.class_name != DONT_CARE)
    yield from (f'{count} {class_name}' for class_name, count in counts.most_common())
    if frame.points is not None:
        yield format_count(len(frame.points), 'point')


def _labels(frame: FrameData) -> str:
    count = sum(each.class_name != DONT_CARE for each in frame.objects)
    return f'{format_count(count, "labelled object")}' if count else 'no labels'


def _picture(
    mode: str, frame: FrameData, camera: int | None, alt: str, caption: str
) -> ReportPicture | None:
    """Draw a JPEG in one of the modes, in full size up to a width; None if data is missing."""
    try:
        pixels = MODES[mode].draw(frame, PictureOptions(camera=camera))
    except MissingDataError:
        return None
    if pixels.shape[1] > _MOST_WIDTH:
        size = (_MOST_WIDTH, max(1, round(pixels.shape[0] * _MOST_WIDTH / pixels.shape[1])))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    data = encode_picture(pixels, '.jpg', _QUALITY)
    return ReportPicture(data, pixels.shape[1], pixels.shape[0], alt, caption)
