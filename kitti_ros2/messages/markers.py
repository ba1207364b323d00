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
from typing import TYPE_CHECKING

from ..drawing.palette import EGO_COLOR, EGO_SIZE_LWH, color_of
from ..options.markers import MarkerColors, MarkerOptions
from .marker_drawing import OBJECT_PARTS, DrawnMarker, MarkerDrawing
from .ros_types import Marker

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model.boxes import Cuboid
    from ..model.geometry import Float64Array
    from .cdr import Parts
    from .naming import FrameNames

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
        trails: Track id to (N, 3) places in map.
        stamp_ns: The scan's.
        frames: Names of map, base_link and velo_link.
        options: Sizes, colours and optional markers.
    """
    # A line needs two points.
    trails = {track: places for track, places in trails.items() if len(places) > 1}
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
    for place, cuboid in enumerate(cuboids):
        number = _number(cuboid, place)
        color = color_of(cuboid.class_name, number, options.colors)
        names = [(part, number) for part in OBJECT_PARTS]
        drawing.object(cuboid, frames.velo, names, color, _caption(cuboid))
    for track, places in sorted(trails.items()):
        color = color_of('', track, MarkerColors.TRACK)
        width = (options.line_width, 0.0, 0.0)
        trail = ('trail', track)
        drawing.add(
            DrawnMarker(frames.map, trail, Marker.LINE_STRIP, color, scale=width, points=places)
        )
    return drawing.parts()


def encode_clear(stamp_ns: int, frame_id: str) -> Parts:
    """Make an array that only deletes earlier markers, serialised."""
    drawing = MarkerDrawing(1, MarkerOptions(), stamp_ns)
    drawing.clear(frame_id)
    return drawing.parts()


def _number(cuboid: Cuboid, place: int) -> int:
    """Return the marker id of an object: its track's, or its index if it has none."""
    if cuboid.track_id is None:
        return place
    return cuboid.track_id if cuboid.track_id >= 0 else -1 - place


def _caption(cuboid: Cuboid) -> str:
    """Format class, id, score if there is one, and distance."""
    x, y, z = cuboid.velo_T_box.translation.tolist()
    score = '' if cuboid.score is None else f' {cuboid.score:.2f}'
    return f'{cuboid.class_name} {cuboid.identity}{score}\n{math.hypot(x, y, z):.1f} m'
