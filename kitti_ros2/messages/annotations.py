# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""2D boxes -> foxglove_msgs/ImageAnnotations, for the Image panel of Foxglove.

Each box is a PointsAnnotation of type LINE_LOOP, and a TextAnnotation above it, with the stamp of
the image: a panel that synchronises annotations shows an image when each chosen topic has an
annotation of exactly its stamp. A message without boxes has a loop without points, which is not
drawn, so that images without objects are shown as well. Both were read in Lichtblick, the open fork
of Foxglove's viewer: packages/suite-base/src/panels/ThreeDeeRender/renderables/ImageMode/
MessageHandler.ts, handleAnnotations, commit 39b9ee1, and annotations/RenderableLineAnnotation.ts,
update, commit 8f299ac.

Foxglove's coordinates begin at the corner of the first pixel (PointsAnnotation.msg), KITTI's at its
centre.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .cdr_writer import CdrWriter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..drawing.image_boxes import StyledBox
    from .cdr import Parts

_LINE_LOOP = 2
_TO_CORNER = 0.5
_CLEAR = (0.0, 0.0, 0.0, 0.0)


def encode_annotations(boxes: Sequence[StyledBox], stamp_ns: int) -> Parts:
    """Make the ImageAnnotations of an image, serialised.

    Args:
        boxes: In the order of drawing.
        stamp_ns: The image's.
    """
    cdr = CdrWriter()
    cdr.uint32(0)  # circles
    cdr.uint32(max(len(boxes), 1))
    for box in boxes:
        left, top, right, bottom = (value + _TO_CORNER for value in box.bounds)
        corners = (left, top, right, top, right, bottom, left, bottom)
        _add_loop(cdr, stamp_ns, corners, _rgba(box.color), box.line_px)
    if not boxes:
        _add_loop(cdr, stamp_ns, (), _CLEAR, 0.0)
    cdr.uint32(len(boxes))
    for box in boxes:
        cdr.time(stamp_ns)
        cdr.float64((box.bounds[0] + _TO_CORNER, box.bounds[1] + _TO_CORNER))
        cdr.text(box.text)
        cdr.float64((box.font_px, *_rgba(box.ink), *_rgba(box.fill)))
    return (cdr.finish(),)


def _add_loop(
    cdr: CdrWriter,
    stamp_ns: int,
    corners: tuple[float, ...],
    color: tuple[float, ...],
    thickness: float,
) -> None:
    """Write a PointsAnnotation."""
    cdr.time(stamp_ns)
    cdr.byte(_LINE_LOOP)
    cdr.uint32(len(corners) // 2)
    cdr.float64((*corners, *color))
    cdr.uint32(0)  # outline_colors
    cdr.float64((*_CLEAR, thickness))


def _rgba(color: tuple[int, int, int]) -> tuple[float, ...]:
    return (*(value / 255 for value in color), 1.0)
