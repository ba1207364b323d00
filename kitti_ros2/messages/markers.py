# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels -> visualization_msgs/MarkerArray, for RViz and Foxglove.

An array begins with a DELETEALL, which removes earlier frames, also after a seek. Per object, in
its own namespace and with the id of its track if it has one: box (a translucent
CUBE), edges (LINE_LIST), heading (ARROW) and text (class, id, distance); per track, if asked for,
trail (LINE_STRIP in map); and ego, the recording car at base_link.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..drawing.labelled_objects import (
    EGO_COLOR,
    EGO_SIZE_LWH,
    NEUTRAL_COLOR,
    PREDICTION_COLOR,
    VERDICT_COLORS,
    color_of,
    distance_of,
    is_missed,
    name_of,
)
from ..model.boxes import EDGES, Verdict, unit_corners
from ..options.messages import MarkerColors, MarkerOptions
from .cdr import CdrWriter, pose_numbers
from .ros_types import Marker

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..drawing.annotate import StyledBox
    from ..drawing.labelled_objects import LabelledObject
    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from .cdr import Parts
    from .naming import FrameNames


# A visualization_msgs/MarkerArray, written marker by marker.

_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_WHITE = (1.0, 1.0, 1.0)
OBJECT_PARTS = ('box', 'edges', 'heading', 'text')
"""The markers of an object."""


def _colors_to_text() -> bytes:
    """Make the empty fields of a Marker between points and text: colors to uv_coordinates."""
    cdr = CdrWriter()
    cdr.uint32(0)
    cdr.text('')
    cdr.header(0, '')
    cdr.text('')
    cdr.uint32(0)
    cdr.uint32(0)
    return cdr.block_bytes()


def _mesh() -> bytes:
    """Make the empty fields of a Marker after text: mesh_resource, mesh_file."""
    cdr = CdrWriter()
    cdr.text('')
    cdr.text('')
    cdr.uint32(0)
    cdr.boolean(value=False)
    return cdr.block_bytes()


_COLORS_TO_TEXT = _colors_to_text()
_MESH = _mesh()
# color, lifetime, frame_locked, and the number of points; always 8-aligned, after the scale.
_COLOR_TO_POINTS = struct.Struct('<4fiiB3xI')


class DrawnMarker(NamedTuple):
    """A visualization_msgs/Marker, without its stamp and lifetime.

    Attributes:
        frame_id: Name of its frame.
        name: Namespace and id.
        kind: Type, a constant of Marker.
        color: Red, green, blue, 0..1.
        pose: x y z in metres, and a quaternion x y z w.
        scale: Metres; what it measures depends on the type.
        alpha: Opacity, 0..1.
        points: (N, 3) metres, for lists and arrows.
        text: For TEXT_VIEW_FACING.
        action: A constant of Marker.
    """

    frame_id: str
    name: tuple[str, int]
    kind: int
    color: tuple[float, float, float]
    pose: tuple[float, ...] = _NO_POSE
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alpha: float = 1.0
    points: Float64Array | None = None
    text: str = ''
    action: int = Marker.ADD


class MarkerDrawing:
    """A MarkerArray under construction."""

    def __init__(self, count: int, options: MarkerOptions, stamp_ns: int) -> None:
        self._cdr = CdrWriter()
        self._cdr.uint32(count)
        self._options = options
        self._stamp_ns = stamp_ns
        self._headers: dict[str, bytes] = {}

    def parts(self) -> Parts:
        """Return the message."""
        return (self._cdr.finish(),)

    def clear(self, frame_id: str) -> None:
        """Add the marker that deletes all others."""
        nothing = (0.0, 0.0, 0.0)
        self.add(DrawnMarker(frame_id, ('', 0), Marker.CUBE, nothing, action=Marker.DELETEALL))

    def object(
        self,
        cuboid: Cuboid,
        frame_id: str,
        names: Sequence[tuple[str, int]],
        color: tuple[float, float, float],
        text: str,
    ) -> None:
        """Add box, edges, heading and text of an object.

        Args:
            cuboid: In velo_link.
            frame_id: Name of velo_link.
            names: Namespace and id of each of OBJECT_PARTS.
            color: Red, green, blue, 0..1.
            text: Shown above it.
        """
        options = self._options
        box, edges, heading, caption = names
        length, _, height = cuboid.size_lwh
        pose = pose_numbers(cuboid.velo_T_box)
        corners = unit_corners()[EDGES.ravel()] * cuboid.size_lwh
        arrow = np.array([[0.0, 0.0, 0.0], [length / 2 + options.arrow_length, 0.0, 0.0]])
        above = (pose[0], pose[1], pose[2] + height / 2 + options.text_height, 0.0, 0.0, 0.0, 1.0)
        width = options.line_width
        thin, thick = (width, 0.0, 0.0), (2 * width, 4 * width, 4 * width)
        tall = (0.0, 0.0, options.text_height)
        size, alpha = cuboid.size_lwh, options.alpha
        self.add(DrawnMarker(frame_id, box, Marker.CUBE, color, pose, size, alpha))
        self.add(DrawnMarker(frame_id, edges, Marker.LINE_LIST, color, pose, thin, points=corners))
        self.add(DrawnMarker(frame_id, heading, Marker.ARROW, color, pose, thick, points=arrow))
        kind = Marker.TEXT_VIEW_FACING
        self.add(DrawnMarker(frame_id, caption, kind, _WHITE, above, tall, text=text))

    def add(self, marker: DrawnMarker) -> None:
        """Write a marker, field by field."""
        cdr = self._cdr
        cdr.block(self._header(marker.frame_id))
        namespace, number = marker.name
        cdr.text(namespace)
        cdr.int32(number, marker.kind, marker.action)
        cdr.float64((*marker.pose, *marker.scale))
        lifetime = divmod(self._options.lifetime_ns, 1_000_000_000)
        count = 0 if marker.points is None else len(marker.points)
        cdr.block(_COLOR_TO_POINTS.pack(*marker.color, marker.alpha, *lifetime, 0, count))
        if marker.points is not None:
            cdr.raw_float64(np.ascontiguousarray(marker.points, '<f8').tobytes())
        cdr.block(_COLORS_TO_TEXT)
        cdr.text(marker.text)
        cdr.block(_MESH)

    def _header(self, frame_id: str) -> bytes:
        if frame_id not in self._headers:
            cdr = CdrWriter()
            cdr.header(self._stamp_ns, frame_id)
            self._headers[frame_id] = cdr.block_bytes()
        return self._headers[frame_id]


# A Passat's measure about the middle of its rear axle, on the ground.
_EGO_POSE = (1.35, 0.0, 0.75, 0.0, 0.0, 0.0, 1.0)


def encode_markers(
    cuboids: Sequence[Cuboid],
    trails: Mapping[int, Float64Array],
    stamp_ns: int,
    frames: FrameNames,
    options: MarkerOptions,
) -> Parts:
    """Make the markers of a frame, serialised.

    Args:
        cuboids: In velo_link.
        trails: Track id to (N, 3) positions in map.
        stamp_ns: The scan's.
        frames: Names of map, base_link and velo_link.
        options: Sizes, colours and optional markers.
    """
    # A line needs two points.
    trails = {track: positions for track, positions in trails.items() if len(positions) > 1}
    count = 1 + options.ego + len(OBJECT_PARTS) * len(cuboids) + len(trails)
    drawing = MarkerDrawing(count, options, stamp_ns)
    drawing.clear(frames.velo)
    if options.ego:
        ego = ('ego', 0)
        drawing.add(
            DrawnMarker(
                frames.base, ego, Marker.CUBE, EGO_COLOR, _EGO_POSE, EGO_SIZE_LWH, options.alpha
            )
        )
    for index, cuboid in enumerate(cuboids):
        number = _number(cuboid, index)
        color = color_of(cuboid.class_name, number, options.colors)
        names = [(part, number) for part in OBJECT_PARTS]
        drawing.object(cuboid, frames.velo, names, color, _caption(cuboid))
    for track, positions in sorted(trails.items()):
        color = color_of('', track, MarkerColors.TRACK)
        width = (options.line_width, 0.0, 0.0)
        trail = ('trail', track)
        drawing.add(
            DrawnMarker(frames.map, trail, Marker.LINE_STRIP, color, scale=width, points=positions)
        )
    return drawing.parts()


def encode_clear(stamp_ns: int, frame_id: str) -> Parts:
    """Make an array that only deletes earlier markers, serialised."""
    drawing = MarkerDrawing(1, MarkerOptions(), stamp_ns)
    drawing.clear(frame_id)
    return drawing.parts()


def _number(cuboid: Cuboid, index: int) -> int:
    """Return the marker id of an object: its track's, or its index if it has none."""
    if cuboid.track_id is None:
        return index
    return cuboid.track_id if cuboid.track_id >= 0 else -1 - index


def _caption(cuboid: Cuboid) -> str:
    """Format class, id, score if there is one, and distance."""
    x, y, z = cuboid.velo_T_box.translation.tolist()
    score = '' if cuboid.score is None else f' {cuboid.score:.2f}'
    return f'{cuboid.class_name} {cuboid.identity}{score}\n{math.hypot(x, y, z):.1f} m'


# Predictions compared with labels -> visualization_msgs/MarkerArray, for RViz and Foxglove.
#
# An array begins with a DELETEALL. Each namespace is a result of the comparison, so that a viewer
# can hide it: true_positive, false_positive and uncounted (on a neighbouring class or a DontCare
# region) are predictions, miss are labels that no prediction finds. Without labels, all are in
# namespace prediction. Each object has box, edges, heading and text (class, track, score, result,
# IoU, distance), as those of labels in markers.py.

_NAMESPACES = {
    Verdict.TRUE_POSITIVE: 'true_positive',
    Verdict.FALSE_POSITIVE: 'false_positive',
    Verdict.FALSE_NEGATIVE: 'miss',
}


def encode_prediction_markers(
    labels: Sequence[LabelledObject],
    predictions: Sequence[LabelledObject],
    stamp_ns: int,
    frame_id: str,
    options: MarkerOptions,
) -> Parts:
    """Make the markers of the predictions of a frame and of the labels that none finds, serialised.

    Args:
        labels: Compared with the predictions.
        predictions: Boxes; those without a 3D box are left out.
        stamp_ns: Nanoseconds.
        frame_id: Name of velo_link.
        options: Sizes of markers.
    """
    missed = [label for label in labels if is_missed(label)]
    shown = [labelled for labelled in (*predictions, *missed) if labelled.cuboid is not None]
    drawing = MarkerDrawing(1 + len(OBJECT_PARTS) * len(shown), options, stamp_ns)
    drawing.clear(frame_id)
    for index, labelled in enumerate(shown):
        namespace, rgb = _style(labelled)
        first = len(OBJECT_PARTS) * index
        names = [(namespace, first + part) for part in range(len(OBJECT_PARTS))]
        red, green, blue = (value / 255 for value in rgb)
        text = f'{name_of(labelled)}\n{distance_of(labelled):.1f} m'
        if labelled.cuboid is not None:
            drawing.object(labelled.cuboid, frame_id, names, (red, green, blue), text)
    return drawing.parts()


def _style(labelled: LabelledObject) -> tuple[str, tuple[int, int, int]]:
    """Return namespace and colour (red, green, blue, 0..255) of an object."""
    if labelled.match is None:
        return 'prediction', PREDICTION_COLOR
    if labelled.match.verdict is None:
        return 'uncounted', NEUTRAL_COLOR
    return _NAMESPACES[labelled.match.verdict], VERDICT_COLORS[labelled.match.verdict]


# 2D boxes -> foxglove_msgs/ImageAnnotations, for the Image panel of Foxglove.
#
# Each box is a PointsAnnotation of type LINE_LOOP, and a TextAnnotation above it, with the stamp of
# the image: a panel that synchronises annotations shows an image when each chosen topic has an
# annotation of exactly its stamp. A message without boxes has a loop without points, which is not
# drawn, so that images without objects are shown as well. Both were read in Lichtblick, the open
# fork of Foxglove's viewer: packages/suite-base/src/panels/ThreeDeeRender/renderables/ImageMode/
# MessageHandler.ts, handleAnnotations, commit 39b9ee1, and annotations/RenderableLineAnnotation.ts,
# update, commit 8f299ac.
#
# Foxglove's coordinates begin at the corner of the first pixel (PointsAnnotation.msg), KITTI's at
# its centre.

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
