# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's SceneUpdate -> visualization_msgs/MarkerArray: its cubes, which are boxes.

A cube's namespace is the id of its entity, its text begins with the class: the value of a metadata
key such as `category` (nuscenes2mcap writes it), or the entity's text. Entities without cubes that
are drawn as pairs of points become line lists. Spheres, arrows, models and other shapes are no
boxes and are not converted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.msgtypes import MARKERS
from ..model.stamps import to_sec_nanosec
from .header import make_header, make_pose
from .ros_types import TYPESTORE, CompressedImage, Marker, Point, Pose, Quaternion, Vector3

if TYPE_CHECKING:
    from .foxglove_fields import Fields


CLASS_KEYS = (
    'class',
    'category',
    'label',
    'type',
    'class_name',
    'category_name',
    'classification',
    'object_class',
    'object_type',
)
"""Keys of metadata, in lower case, whose value is the class of an entity."""

_SCORE_KEYS = ('score', 'confidence', 'probability')
_LINE_LIST = 2  # LinePrimitive.Type
_ALL = 1  # SceneEntityDeletion.Type
_NOTHING = np.empty(0, np.uint8)


class _Entity(NamedTuple):
    """Stamp (nanoseconds), frame and id."""

    stamp_ns: int
    frame_id: str
    name: str


def encode_scene(scene: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    """Make the MarkerArray of a SceneUpdate.

    Args:
        scene: The message.
        log_ns: Stamp of what has none, nanoseconds.

    Raises:
        ValueError: A value is of a wrong type.
    """
    markers = [_deletion(each, log_ns) for each in scene.children('deletions')]
    for entity in scene.children('entities'):
        place = _Entity(
            entity.stamp_ns('timestamp', log_ns), entity.text('frame_id'), entity.text('id')
        )
        text = _caption(entity)
        cubes = entity.children('cubes')
        for number, cube in enumerate(cubes):
            marker = _marker(place, number, Marker.CUBE)
            marker.pose = make_pose(cube.pose('pose'))
            marker.scale = Vector3(*cube.xyz('size'))
            marker.text = text
            _paint(marker, cube)
            markers.append(marker)
        if not cubes:
            lines = entity.children('lines')
            pairs = [each for each in lines if each.integer('type') == _LINE_LIST]
            markers += [_lines(place, number, each) for number, each in enumerate(pairs)]
    return TYPESTORE.types[MARKERS](markers)


def _caption(entity: Fields) -> str:
    """Return class, texts and score of an entity, a line each; the first is the class if known."""
    metadata = {
        each.text('key').lower(): each.text('value') for each in entity.children('metadata')
    }
    lines = [metadata[key] for key in CLASS_KEYS if metadata.get(key)][:1]
    lines += [each.text('text') for each in entity.children('texts')]
    lines += [metadata[key] for key in _SCORE_KEYS if metadata.get(key)][:1]
    return '\n'.join(line for line in lines if line)


def _deletion(deletion: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    place = _Entity(deletion.stamp_ns('timestamp', log_ns), '', deletion.text('id'))
    marker = _marker(place, 0, Marker.CUBE)
    is_all = deletion.integer('type') == _ALL
    marker.action = Marker.DELETEALL if is_all else Marker.DELETE
    return marker


def _lines(place: _Entity, number: int, line: Fields) -> Any:  # noqa: ANN401 - a rosbags class
    points = [
        Point(each.number('x'), each.number('y'), each.number('z'))
        for each in line.children('points')
    ]
    indices = line.numbers('indices')
    if len(indices):
        if not ((indices >= 0) & (indices < len(points))).all():
            raise ValueError('indices of a line are beyond its points')
        points = [points[int(index)] for index in indices]
    marker = _marker(place, number, Marker.LINE_LIST)
    marker.pose = make_pose(line.pose('pose'))
    marker.scale = Vector3(line.number('thickness'), 0.0, 0.0)
    marker.points = points
    _paint(marker, line)
    return marker


def _marker(place: _Entity, number: int, kind: int) -> Any:  # noqa: ANN401 - a rosbags class
    header = make_header(place.stamp_ns, place.frame_id)
    types = TYPESTORE.types
    return types['visualization_msgs/msg/Marker'](
        header=header,
        ns=place.name,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=Pose(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)),
        scale=Vector3(0.0, 0.0, 0.0),
        color=types['std_msgs/msg/ColorRGBA'](0.0, 0.0, 0.0, 0.0),
        lifetime=types['builtin_interfaces/msg/Duration'](*to_sec_nanosec(0)),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource='',
        texture=CompressedImage(make_header(0, ''), '', _NOTHING),
        uv_coordinates=[],
        text='',
        mesh_resource='',
        mesh_file=types['visualization_msgs/msg/MeshFile']('', _NOTHING),
        mesh_use_embedded_materials=False,
    )


def _paint(marker: Any, shape: Fields) -> None:  # noqa: ANN401 - a rosbags class
    color = shape.child('color')
    for name in 'rgba':
        setattr(marker.color, name, color.number(name))
