# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""visualization_msgs/MarkerArray and Marker -> boxes, lines, arrows and texts.

As in RViz, markers stay until they are replaced, deleted, or their lifetime has expired; each
message of a topic updates all its remaining markers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from ..messages.header import stamp_ns_of, transform_of
from ..messages.ros_types import Marker
from ..model.geometry import Transform
from ..model.stamps import from_sec_nanosec
from .boxes import rows_of, unit_quaternions
from .entities import Converter, EntityUpdate, entity_path
from .program_survey import frame_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ..model.geometry import Float64Array
    from .entities import Context

_KINDS = {
    Marker.CUBE: 'boxes',
    Marker.LINE_STRIP: 'lines',
    Marker.LINE_LIST: 'lines',
    Marker.ARROW: 'arrows',
    Marker.TEXT_VIEW_FACING: 'texts',
}
_OTHERS = {
    getattr(Marker, name): name
    for name in (
        'SPHERE',
        'CYLINDER',
        'CUBE_LIST',
        'SPHERE_LIST',
        'POINTS',
        'MESH_RESOURCE',
        'TRIANGLE_LIST',
        'ARROW_STRIP',
    )
}


class MarkerConverter(Converter):
    """The markers of a topic."""

    def __init__(self, topic: str, context: Context) -> None:
        super().__init__(topic, context)
        self._shown: dict[tuple[str, int], Any] = {}
        self._groups: dict[tuple[str, str], list[Any]] = {}

    def convert(self, message: Any) -> Iterator[EntityUpdate]:  # noqa: ANN401 - a rosbags class
        """Yield an update for each kind of marker in each frame, also for removed ones."""
        markers = message.markers if hasattr(message, 'markers') else [message]
        for marker in markers:
            self._take(marker)
        if markers:
            self._outlive(max(stamp_ns_of(marker.header) for marker in markers))
        for group in self._groups.values():
            group.clear()
        for marker in self._shown.values():
            key = (_KINDS[marker.type], frame_name(marker.header.frame_id))
            self._groups.setdefault(key, []).append(marker)
        for (kind, frame), group in self._groups.items():
            path = entity_path(self.topic, kind, frame)
            yield EntityUpdate(path, [_SHAPES[kind](group)], frame)

    def _take(self, marker: Any) -> None:  # noqa: ANN401 - a rosbags class
        key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            self._shown.clear()
        elif marker.action == Marker.DELETE:
            self._shown.pop(key, None)
        elif marker.type in _KINDS:
            self._shown[key] = marker
        else:
            name = _OTHERS.get(marker.type, str(marker.type))
            self.context.note(f'{self.topic}: markers of type {name} are not shown')

    def _outlive(self, now_ns: int) -> None:
        for key, marker in list(self._shown.items()):
            lifetime = from_sec_nanosec(marker.lifetime.sec, marker.lifetime.nanosec)
            if lifetime and stamp_ns_of(marker.header) + lifetime < now_ns:
                del self._shown[key]


def _boxes(markers: list[Any]) -> rr.AsComponents:
    return rr.Boxes3D(
        centers=rows_of(marker.pose.position for marker in markers),
        sizes=rows_of(marker.scale for marker in markers),
        quaternions=unit_quaternions(marker.pose.orientation for marker in markers),
        colors=_marker_colors(markers),
    )


def _lines(markers: list[Any]) -> rr.AsComponents:
    strips: list[Float64Array] = []
    colors: list[tuple[float, ...]] = []
    for marker, color in zip(markers, _marker_colors(markers), strict=True):
        points = _points(marker)
        pairs = marker.type == Marker.LINE_LIST
        found = list(points[: len(points) // 2 * 2].reshape(-1, 2, 3)) if pairs else [points]
        strips += found
        colors += [color] * len(found)
    return rr.LineStrips3D(strips, colors=colors)


def _arrows(markers: list[Any]) -> rr.AsComponents:
    origins, vectors = [], []
    for marker in markers:
        ends = _points(marker)
        if len(ends) < 2:
            # Without points an arrow lies along x of its pose; its length is scale.x.
            ends = _place(marker).apply([[0.0, 0.0, 0.0], [marker.scale.x, 0.0, 0.0]])
        origins.append(ends[0])
        vectors.append(ends[1] - ends[0])
    return rr.Arrows3D(
        origins=np.reshape(origins, (-1, 3)),
        vectors=np.reshape(vectors, (-1, 3)),
        colors=_marker_colors(markers),
    )


def _texts(markers: list[Any]) -> rr.AsComponents:
    return rr.Points3D(
        rows_of(marker.pose.position for marker in markers),
        labels=[marker.text for marker in markers],
        show_labels=True,
        colors=_marker_colors(markers),
        radii=[0.0],
    )


def _place(marker: Any) -> Transform:  # noqa: ANN401 - a rosbags class
    """Return frame_T_marker; a quaternion of zeros means no rotation."""
    q = marker.pose.orientation
    if not any((q.x, q.y, q.z, q.w)):
        p = marker.pose.position
        return Transform.from_translation((p.x, p.y, p.z))
    return transform_of(marker.pose)


def _points(marker: Any) -> Float64Array:  # noqa: ANN401 - a rosbags class
    """Return (N, 3) points in the marker's frame."""
    return _place(marker).apply(rows_of(marker.points))


def _marker_colors(markers: list[Any]) -> list[tuple[int, int, int, int]]:
    """Return red, green, blue and opacity, 0..255."""
    return [
        tuple(round(255 * min(max(value, 0.0), 1.0)) for value in (c.r, c.g, c.b, c.a))
        for c in (marker.color for marker in markers)
    ]


_SHAPES: dict[str, Callable[[list[Any]], rr.AsComponents]] = {
    'boxes': _boxes,
    'lines': _lines,
    'arrows': _arrows,
    'texts': _texts,
}
