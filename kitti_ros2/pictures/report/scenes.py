# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A few frames of a recording in pictures, small enough for a page."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ...boxes import DONT_CARE
from ...errors import KittiRos2Error
from ...quantities import format_count
from ...samples import Stream
from .contents import Picture, Scene
from .stand_in import draw
from .statistics import spread

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ..frame import Frame, FrameSource, Pixels

_QUALITY = 80
_CAMERA_WIDTH = 1100
_PAIR_WIDTH = 800
_PREFERRED = (2, 0, 3, 1, 4)
_MOST_CAMERAS = 4


def draw_scenes(
    source: FrameSource,
    pictured: Sequence[int],
    most: int,
    seen: Callable[[Frame], None],
    step: Callable[[], None],
) -> tuple[Scene, ...]:
    """Up to most frames, evenly spread, each from a camera, with points in it, and from above.

    Args:
        source: The frames.
        pictured: Numbers of those that have something to see.
        most: How many.
        seen: Called with each frame.
        step: Called after each.
    """
    camera = next((index for index in _PREFERRED if index in source.cameras), None)
    wanted = {Stream.SCAN.value, Stream.LABELS.value}
    if camera is not None:
        wanted.add(f'image_{camera}')
    scenes = []
    for place in spread(len(pictured), most):
        frame = source.frame(pictured[place], frozenset(wanted))
        seen(frame)
        pictures = tuple(_pictures(frame, source, camera))
        if pictures:
            scenes.append(Scene(frame.number, frame.stamp_ns, tuple(_words(frame)), pictures))
        step()
    return tuple(scenes)


def draw_projections(
    source: FrameSource, pictured: Sequence[int], seen: Callable[[Frame], None]
) -> tuple[Picture, ...]:
    """The points of the frame in the middle over the image of each camera."""
    if not pictured:
        return ()
    images = [Stream(f'image_{index}').value for index in sorted(source.cameras)][:_MOST_CAMERAS]
    frame = source.frame(pictured[len(pictured) // 2], frozenset({Stream.SCAN.value, *images}))
    seen(frame)
    found = (_projection(frame, index, source.cameras[index]) for index in sorted(frame.images))
    return tuple(picture for picture in found if picture is not None)


def _pictures(frame: Frame, source: FrameSource, camera: int | None) -> Iterator[Picture]:
    """What can be drawn of a frame, the camera's image first."""
    what = f'frame {frame.number}'
    if camera is not None and camera in frame.images:
        name = source.cameras[camera]
        pixels = draw('boxes', frame, camera)
        alt = f'Image of camera {name}, {what}, with {_labels(frame)}'
        yield encode_picture(pixels, _CAMERA_WIDTH, alt, f'Camera {name}')
        picture = _projection(frame, camera, name)
        if picture is not None:
            yield picture
    if frame.points is not None and len(frame.points):
        alt = f'Points of the scanner from above, {what}, with {_labels(frame)}'
        yield encode_picture(draw('bev', frame, camera), _PAIR_WIDTH, alt, 'From above')


def _projection(frame: Frame, camera: int, name: str) -> Picture | None:
    """Points over an image, None where they cannot be brought there."""
    if frame.points is None or frame.calibration is None or camera not in frame.images:
        return None
    try:
        pixels = draw('lidar', frame, camera)
    except (KittiRos2Error, ValueError):
        return None
    alt = f'Points of the scanner over the image of camera {name}, frame {frame.number}'
    caption = f'Points in camera {name}, coloured by depth'
    return encode_picture(pixels, _PAIR_WIDTH, alt, caption)


def _words(frame: Frame) -> Iterator[str]:
    counts = Counter(each.kind for each in frame.objects if each.kind != DONT_CARE)
    yield from (f'{count} {kind}' for kind, count in counts.most_common())
    if frame.points is not None:
        yield format_count(len(frame.points), 'point')


def _labels(frame: Frame) -> str:
    count = sum(each.kind != DONT_CARE for each in frame.objects)
    return f'{format_count(count, "labelled object")}' if count else 'no labels'


def encode_picture(pixels: Pixels, width: int, alt: str, caption: str) -> Picture:
    """A JPEG no wider than so many pixels."""
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    small: Pixels = pixels
    if pixels.shape[1] > width:
        small = np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))
    done, data = cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise AssertionError('OpenCV encodes every image of bytes')
    return Picture(data.tobytes(), small.shape[1], small.shape[0], alt, caption)
