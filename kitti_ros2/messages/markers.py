# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Labels -> visualization_msgs/MarkerArray: what people look at in RViz and Foxglove.

An array begins with a DELETEALL, so nothing of an earlier frame stays, also after a seek. Per
object, in its own namespace and with the id of its track where it has one: box (a translucent
CUBE), edges (LINE_LIST), heading (ARROW) and text (class, id, distance); per track, if asked for,
trail (LINE_STRIP in map); and ego, the recording car at base_link.
"""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import (
    builtin_interfaces__msg__Duration as Duration,
)
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__CompressedImage as CompressedImage,
)
from rosbags.typesys.stores.ros2_jazzy import (
    std_msgs__msg__ColorRGBA as ColorRGBA,
)
from rosbags.typesys.stores.ros2_jazzy import (
    visualization_msgs__msg__Marker as Marker,
)
from rosbags.typesys.stores.ros2_jazzy import (
    visualization_msgs__msg__MarkerArray as MarkerArray,
)
from rosbags.typesys.stores.ros2_jazzy import (
    visualization_msgs__msg__MeshFile as MeshFile,
)

from ..boxes import EDGES, unit_corners
from ..geometry import Transform
from ..options import MarkerColors
from ..stamps import to_sec_nanosec
from .header import Point, Vector3, make_header, make_pose

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..boxes import Cuboid
    from ..geometry import Float64Array
    from ..options import MarkerOptions
    from .header import Header
    from .naming import Frames

_CLASS_COLORS = {
    'Car': (0.13, 0.59, 0.95),
    'Van': (0.0, 0.74, 0.83),
    'Truck': (0.25, 0.32, 0.71),
    'Tram': (0.40, 0.23, 0.72),
    'Pedestrian': (0.96, 0.26, 0.21),
    'Person_sitting': (1.0, 0.44, 0.26),
    'Person (sitting)': (1.0, 0.44, 0.26),
    'Cyclist': (1.0, 0.76, 0.03),
    'Misc': (0.62, 0.62, 0.62),
}
_EGO_COLOR = (0.30, 0.69, 0.31)
_EGO_SIZE_LWH = (4.0, 1.7, 1.5)
_EGO_MIDDLE = Transform.from_translation((1.35, 0.0, 0.75))
"""A Passat's measure about the middle of its rear axle, on the ground."""

_GOLDEN_TURN = 0.6180339887498949
_ORIGIN = Transform.identity()


def encode_markers(
    cuboids: Sequence[Cuboid],
    trails: Mapping[int, Float64Array],
    stamp_ns: int,
    frames: Frames,
    options: MarkerOptions,
) -> MarkerArray:
    """The markers of a frame.

    Args:
        cuboids: In velo_link.
        trails: Track id to (N, 3) places in map.
        stamp_ns: The scan's.
        frames: Names of map, base_link and velo_link.
        options: Sizes, colours, what is drawn.
    """
    factory = _Factory(options)
    velo = make_header(stamp_ns, frames.velo)
    markers = [factory.clear(velo)]
    if options.ego:
        markers.append(factory.ego(make_header(stamp_ns, frames.base)))
    for place, cuboid in enumerate(cuboids):
        markers += factory.object(cuboid, place, velo)
    world = make_header(stamp_ns, frames.map)
    markers += [factory.trail(track, places, world) for track, places in sorted(trails.items())]
    return MarkerArray(cast('Any', markers))  # rosbags types the field by an older Marker


def color_of(kind: str, number: int, colors: MarkerColors) -> tuple[float, float, float]:
    """Red, green, blue, 0..1: of a class, or of a track's number.

    Unknown classes get a colour of their own by their name, the same in every run.
    """
    if colors is MarkerColors.CLASS and kind in _CLASS_COLORS:
        return _CLASS_COLORS[kind]
    seed = number if colors is MarkerColors.TRACK else sum(kind.encode())
    return colorsys.hsv_to_rgb(seed * _GOLDEN_TURN % 1.0, 0.75, 0.95)


class _Factory:
    """Makes markers that share the options."""

    def __init__(self, options: MarkerOptions) -> None:
        self._options = options
        sec, nanosec = to_sec_nanosec(options.lifetime_ns)
        self._lifetime = Duration(sec, nanosec)
        self._texture = CompressedImage(make_header(0, ''), '', np.empty(0, np.uint8))
        self._mesh = MeshFile('', np.empty(0, np.uint8))

    def clear(self, header: Header) -> Marker:
        """The marker that deletes all others."""
        return self._make(header, '', 0, Marker.CUBE, (0.0, 0.0, 0.0), action=Marker.DELETEALL)

    def ego(self, header: Header) -> Marker:
        """The recording car."""
        return self._make(
            header, 'ego', 0, Marker.CUBE, _EGO_COLOR,
            pose=_EGO_MIDDLE, scale=_EGO_SIZE_LWH, alpha=self._options.alpha,
        )  # fmt: skip

    def object(self, cuboid: Cuboid, place: int, header: Header) -> list[Marker]:
        """Box, edges, heading and text of an object."""
        options = self._options
        number = place if cuboid.track_id is None else cuboid.track_id
        color = color_of(cuboid.kind, number, options.colors)
        length, width, height = cuboid.size_lwh
        corners = unit_corners() * [length, width, height]
        heading = np.array([[0.0, 0.0, 0.0], [length / 2 + options.arrow_length, 0.0, 0.0]])
        shaft = 2 * options.line_width
        above = cuboid.velo_T_box @ Transform.from_translation(
            (0.0, 0.0, height / 2 + options.text_height)
        )
        distance = float(np.linalg.norm(cuboid.velo_T_box.translation))
        score = '' if cuboid.score is None else f' {cuboid.score:.2f}'
        text = f'{cuboid.kind} {cuboid.identity}{score}\n{distance:.1f} m'
        box, line = cuboid.velo_T_box, (options.line_width, 0.0, 0.0)
        return [
            self._make(header, 'box', number, Marker.CUBE, color, pose=box,
                       scale=cuboid.size_lwh, alpha=options.alpha),
            self._make(header, 'edges', number, Marker.LINE_LIST, color, pose=box, scale=line,
                       points=corners[EDGES.ravel()]),
            self._make(header, 'heading', number, Marker.ARROW, color, pose=box,
                       scale=(shaft, 2 * shaft, 2 * shaft), points=heading),
            self._make(header, 'text', number, Marker.TEXT_VIEW_FACING, (1.0, 1.0, 1.0),
                       pose=above, scale=(0.0, 0.0, options.text_height), text=text),
        ]  # fmt: skip

    def trail(self, track: int, places: Float64Array, header: Header) -> Marker:
        """Where a track was, in map."""
        color = color_of('', track, MarkerColors.TRACK)
        scale = (self._options.line_width, 0.0, 0.0)
        return self._make(
            header, 'trail', track, Marker.LINE_STRIP, color, scale=scale, points=places
        )

    def _make(  # noqa: PLR0913 - a marker has that many parts
        self,
        header: Header,
        namespace: str,
        number: int,
        kind: int,
        color: tuple[float, float, float],
        *,
        pose: Transform = _ORIGIN,
        scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
        alpha: float = 1.0,
        points: Float64Array | None = None,
        text: str = '',
        action: int = Marker.ADD,
    ) -> Marker:
        return Marker(
            header=header,
            ns=namespace,
            id=number,
            type=kind,
            action=action,
            pose=make_pose(pose),
            scale=Vector3(*scale),
            color=ColorRGBA(*color, alpha),
            lifetime=self._lifetime,
            frame_locked=False,
            points=[] if points is None else [Point(*place) for place in points.tolist()],
            colors=[],
            texture_resource='',
            texture=self._texture,
            uv_coordinates=[],
            text=text,
            mesh_resource='',
            mesh_file=self._mesh,
            mesh_use_embedded_materials=False,
        )
