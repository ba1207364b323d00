# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A visualization_msgs/MarkerArray, written marker by marker."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.boxes import EDGES, unit_corners
from .cdr_writer import CdrWriter
from .header import pose_numbers
from .ros_types import Marker

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from ..options.markers import MarkerOptions
    from .cdr import Parts

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
