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
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.palette import EGO_COLOR, EGO_SIZE_LWH, color_of
from ..model.boxes import EDGES, unit_corners
from ..options.messages import MarkerColors, MarkerOptions
from .cdr_writer import CdrWriter
from .header import pose_numbers
from .ros_types import Marker

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from .cdr import Parts
    from .naming import FrameNames

# A Passat's measure about the middle of its rear axle, on the ground.
_EGO_POSE = (1.35, 0.0, 0.75, 0.0, 0.0, 0.0, 1.0)
_NO_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_WHITE = (1.0, 1.0, 1.0)


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
        trails: Track id to (N, 3) places in map.
        stamp_ns: The scan's.
        frames: Names of map, base_link and velo_link.
        options: Sizes, colours and optional markers.
    """
    # A line needs two points.
    trails = {track: places for track, places in trails.items() if len(places) > 1}
    drawing = _Drawing(1 + options.ego + 4 * len(cuboids) + len(trails), options, stamp_ns)
    drawing.clear(frames.velo)
    if options.ego:
        drawing.ego(frames.base)
    for place, cuboid in enumerate(cuboids):
        drawing.object(cuboid, _number(cuboid, place), frames.velo)
    for track, places in sorted(trails.items()):
        drawing.trail(track, places, frames.map)
    return drawing.parts()


def encode_clear(stamp_ns: int, frame_id: str) -> Parts:
    """Make an array that only deletes earlier markers, serialised."""
    drawing = _Drawing(1, MarkerOptions(), stamp_ns)
    drawing.clear(frame_id)
    return drawing.parts()


def _number(cuboid: Cuboid, place: int) -> int:
    """Return the marker id of an object: its track's, or its index if it has none."""
    if cuboid.track_id is None:
        return place
    return cuboid.track_id if cuboid.track_id >= 0 else -1 - place


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


class _Drawing:
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
        self._add(frame_id, ('', 0), Marker.CUBE, (0.0, 0.0, 0.0), action=Marker.DELETEALL)

    def ego(self, frame_id: str) -> None:
        """Add the recording car."""
        self._add(
            frame_id, ('ego', 0), Marker.CUBE, EGO_COLOR,
            pose=_EGO_POSE, scale=EGO_SIZE_LWH, alpha=self._options.alpha,
        )  # fmt: skip

    def object(self, cuboid: Cuboid, number: int, frame_id: str) -> None:
        """Add box, edges, heading and text of an object."""
        options = self._options
        color = color_of(cuboid.class_name, number, options.colors)
        length, _, height = cuboid.size_lwh
        pose = pose_numbers(cuboid.velo_T_box)
        width, shaft = (options.line_width, 0.0, 0.0), 2 * options.line_width
        corners = unit_corners()[EDGES.ravel()] * cuboid.size_lwh
        heading = np.array([[0.0, 0.0, 0.0], [length / 2 + options.arrow_length, 0.0, 0.0]])
        above = (pose[0], pose[1], pose[2] + height / 2 + options.text_height, 0.0, 0.0, 0.0, 1.0)
        self._add(
            frame_id,
            ('box', number),
            Marker.CUBE,
            color,
            pose=pose,
            scale=cuboid.size_lwh,
            alpha=options.alpha,
        )
        self._add(
            frame_id,
            ('edges', number),
            Marker.LINE_LIST,
            color,
            pose=pose,
            scale=width,
            points=corners,
        )
        self._add(
            frame_id,
            ('heading', number),
            Marker.ARROW,
            color,
            pose=pose,
            scale=(shaft, 2 * shaft, 2 * shaft),
            points=heading,
        )
        self._add(frame_id, ('text', number), Marker.TEXT_VIEW_FACING, _WHITE, pose=above,
                  scale=(0.0, 0.0, options.text_height), text=_caption(cuboid))  # fmt: skip

    def trail(self, track: int, places: Float64Array, frame_id: str) -> None:
        """Add the earlier positions of a track."""
        color = color_of('', track, MarkerColors.TRACK)
        scale = (self._options.line_width, 0.0, 0.0)
        self._add(frame_id, ('trail', track), Marker.LINE_STRIP, color, scale=scale, points=places)

    def _add(  # noqa: PLR0913 - a marker has that many parts
        self,
        frame_id: str,
        name: tuple[str, int],
        kind: int,
        color: tuple[float, float, float],
        *,
        pose: tuple[float, ...] = _NO_POSE,
        scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
        alpha: float = 1.0,
        points: Float64Array | None = None,
        text: str = '',
        action: int = Marker.ADD,
    ) -> None:
        """Write a visualization_msgs/Marker, field by field."""
        cdr = self._cdr
        cdr.block(self._header(frame_id))
        cdr.text(name[0])
        cdr.int32(name[1], kind, action)
        cdr.float64((*pose, *scale))
        lifetime = divmod(self._options.lifetime_ns, 1_000_000_000)
        count = 0 if points is None else len(points)
        cdr.block(_COLOR_TO_POINTS.pack(*color, alpha, *lifetime, 0, count))
        if points is not None:
            cdr.raw_float64(np.ascontiguousarray(points, '<f8').tobytes())
        cdr.block(_COLORS_TO_TEXT)
        cdr.text(text)
        cdr.block(_MESH)

    def _header(self, frame_id: str) -> bytes:
        if frame_id not in self._headers:
            cdr = CdrWriter()
            cdr.header(self._stamp_ns, frame_id)
            self._headers[frame_id] = cdr.block_bytes()
        return self._headers[frame_id]


def _caption(cuboid: Cuboid) -> str:
    """Format class, id, score if there is one, and distance."""
    x, y, z = cuboid.velo_T_box.translation.tolist()
    score = '' if cuboid.score is None else f' {cuboid.score:.2f}'
    return f'{cuboid.class_name} {cuboid.identity}{score}\n{math.hypot(x, y, z):.1f} m'
