# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A few frames of a recording in pictures, small enough for a page."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import cv2

from .contents import Picture, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..frame import FrameSource, Pixels

from .statistics import spread

_QUALITY = 82


def encode_picture(pixels: Pixels, width: int, alt: str, caption: str) -> Picture:
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    if pixels.shape[1] > width:
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return Picture(data.tobytes(), pixels.shape[1], pixels.shape[0], alt, caption)


def draw_scenes(
    source: FrameSource, pictured: Sequence[int], most: int, seen, step
) -> tuple[Scene, ...]:
    scenes = []
    for place in spread(len(pictured), most):
        frame = source.frame(pictured[place])
        seen(frame)
        counts = Counter(each.kind for each in frame.objects)
        pictures = tuple(
            encode_picture(
                image,
                1242,
                f'Camera {index} of frame {frame.number}',
                f'Camera {source.cameras[index]}',
            )
            for index, image in list(frame.images.items())[:1]
        )
        scenes.append(
            Scene(
                frame.number, frame.stamp_ns, tuple(f'{n} {k}' for k, n in counts.items()), pictures
            )
        )
        step()
    return tuple(scenes)


def draw_projections(source, pictured, seen):
    return ()
