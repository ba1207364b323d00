# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Foxglove's SceneUpdate -> visualization_msgs/MarkerArray: its boxes alone, or all its shapes.

A cube's namespace is the id of its entity, its text begins with the class: the value of a
metadata key such as `category` (nuscenes2mcap writes it), or the entity's text.

Boxes alone are the cubes, and of entities without cubes the lines that are drawn as pairs of
points. All shapes have namespaces of their own behind the entity's id, such as `7f3a/lines`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..model.bag_formats import MARKERS
from ..model.streams import to_sec_nanosec
from .cdr import make_header, make_pose
from .ros_types import TYPESTORE, CompressedImage, Marker, Point, Pose, Quaternion, Vector3

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import TypeAlias

    from .foxglove_fields import Fields

    Shape: TypeAlias = Callable[['_Entity', str, int, Fields], Any]

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
_LINE_STRIP, _LINE_LOOP, _LINE_LIST = range(3)  # LinePrimitive.Type
_ALL = 1  # SceneEntityDeletion.Type
_NOTHING = np.empty(0, np.uint8)

PIXEL_WIDTH_M = 0.05
"""The width of lines, and a tenth of the height of texts, whose size is in pixels of a screen."""

_ENDINGS = {
    'model/gltf-binary': 'glb',
    'model/gltf+json': 'gltf',
    'model/stl': 'stl',
    'model/vnd.collada+xml': 'dae',
    'model/obj': 'obj',
}
"""The ending of a file by its media type."""


class _Entity(NamedTuple):
    """Stamp (nanoseconds), frame, id, lifetime (nanoseconds; 0 is endless), text."""

    stamp_ns: int
    frame_id: str
    name: str
    lifetime_ns: int = 0
    is_locked: bool = False
    text: str = ''

    @classmethod
    def of(cls, entity: Fields, log_ns: int) -> _Entity:
        """Read it from the fields of an entity."""
        return cls(
            entity.stamp_ns('timestamp', log_ns),
            entity.text('frame_id'),
            entity.text('id'),
            entity.stamp_ns('lifetime', 0),
            bool(entity.value('frame_locked')),
            _caption(entity),
        )


def encode_boxes(scene: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    """Make the MarkerArray of the boxes of a SceneUpdate.

    Args:
        scene: The message.
        log_ns: Stamp of what has none, nanoseconds.

    Raises:
        ValueError: A value is of a wrong type.
    """
    markers = [_deletion(child, log_ns, '') for child in scene.children('deletions')]
    for entity in scene.children('entities'):
        owner = _Entity.of(entity, log_ns)
        cubes = entity.children('cubes')
        markers += [_cube(owner, owner.name, number, cube) for number, cube in enumerate(cubes)]
        if not cubes:
            lines = entity.children('lines')
            pairs = [line for line in lines if line.integer('type') == _LINE_LIST]
            markers += [_line(owner, owner.name, *numbered) for numbered in enumerate(pairs)]
    return TYPESTORE.types[MARKERS](markers)


def encode_shapes(scene: Fields, log_ns: int) -> Any:  # noqa: ANN401 - a rosbags class
    """Make the MarkerArray of all shapes of a SceneUpdate.

    Sizes in pixels become PIXEL_WIDTH_M, cones become cylinders, and texts face the viewer.

    Args:
        scene: The message.
        log_ns: Stamp of what has none, nanoseconds.

    Raises:
        ValueError: A value is of a wrong type.
    """
    markers = []
    for deletion in scene.children('deletions'):
        kinds = [''] if deletion.integer('type') == _ALL else _SHAPES
        markers += [_deletion(deletion, log_ns, kind) for kind in kinds]
    for entity in scene.children('entities'):
        markers += _shapes(entity, _Entity.of(entity, log_ns))
    return TYPESTORE.types[MARKERS](markers)


def _shapes(entity: Fields, owner: _Entity) -> Iterator[Any]:
    for kind, (name, make) in _SHAPES.items():
        namespace = _namespace(owner.name, kind)
        for number, shape in enumerate(entity.children(name)):
            yield make(owner, namespace, number, shape)


def _namespace(name: str, kind: str) -> str:
    return '/'.join(filter(None, (name, kind)))


def _caption(entity: Fields) -> str:
    """Return class, texts and score of an entity, a line each; the first is the class if known."""
    metadata = {
        child.text('key').lower(): child.text('value') for child in entity.children('metadata')
    }
    lines = [metadata[key] for key in CLASS_KEYS if metadata.get(key)][:1]
    lines += [child.text('text') for child in entity.children('texts')]
    lines += [metadata[key] for key in _SCORE_KEYS if metadata.get(key)][:1]
    return '\n'.join(line for line in lines if line)


def _deletion(deletion: Fields, log_ns: int, kind: str) -> Any:  # noqa: ANN401 - a rosbags class
    owner = _Entity(deletion.stamp_ns('timestamp', log_ns), '', deletion.text('id'))
    marker = _marker(owner, _namespace(owner.name, kind), 0, Marker.CUBE)
    is_all = deletion.integer('type') == _ALL
    marker.action = Marker.DELETEALL if is_all else Marker.DELETE
    return marker


# A marker of each kind of shape.


def _cube(owner: _Entity, namespace: str, number: int, cube: Fields) -> Any:  # noqa: ANN401 - as above
    marker = _solid(Marker.CUBE, owner, namespace, number, cube)
    marker.text = owner.text
    return marker


def _sphere(owner: _Entity, namespace: str, number: int, sphere: Fields) -> Any:  # noqa: ANN401
    return _solid(Marker.SPHERE, owner, namespace, number, sphere)


def _cylinder(owner: _Entity, namespace: str, number: int, cylinder: Fields) -> Any:  # noqa: ANN401
    return _solid(Marker.CYLINDER, owner, namespace, number, cylinder)


def _solid(kind: int, owner: _Entity, namespace: str, number: int, shape: Fields) -> Any:  # noqa: ANN401
    marker = _shape(kind, owner, namespace, number, shape)
    marker.scale = Vector3(*shape.xyz('size'))
    return marker


def _arrow(owner: _Entity, namespace: str, number: int, arrow: Fields) -> Any:  # noqa: ANN401
    """Make an arrow of two points, for which scale is the diameters and the length of the head."""
    marker = _shape(Marker.ARROW, owner, namespace, number, arrow)
    head = arrow.number('head_length')
    marker.scale = Vector3(arrow.number('shaft_diameter'), arrow.number('head_diameter'), head)
    marker.points = [Point(0.0, 0.0, 0.0), Point(arrow.number('shaft_length') + head, 0.0, 0.0)]
    return marker


def _line(owner: _Entity, namespace: str, number: int, line: Fields) -> Any:  # noqa: ANN401
    kind = line.integer('type')
    is_list = kind == _LINE_LIST
    marker = _shape(
        Marker.LINE_LIST if is_list else Marker.LINE_STRIP, owner, namespace, number, line
    )
    is_pixels = bool(line.value('scale_invariant'))
    marker.scale = Vector3(PIXEL_WIDTH_M if is_pixels else line.number('thickness'), 0.0, 0.0)
    _add_points(marker, line)
    if kind == _LINE_LOOP:
        marker.points += marker.points[:1]
        marker.colors += marker.colors[:1]
    return marker


def _triangles(owner: _Entity, namespace: str, number: int, triangles: Fields) -> Any:  # noqa: ANN401
    marker = _shape(Marker.TRIANGLE_LIST, owner, namespace, number, triangles)
    marker.scale = Vector3(1.0, 1.0, 1.0)
    _add_points(marker, triangles)
    return marker


def _text(owner: _Entity, namespace: str, number: int, text: Fields) -> Any:  # noqa: ANN401
    marker = _shape(Marker.TEXT_VIEW_FACING, owner, namespace, number, text)
    is_pixels = bool(text.value('scale_invariant'))
    height_m = 10 * PIXEL_WIDTH_M if is_pixels else text.number('font_size')
    marker.scale = Vector3(0.0, 0.0, height_m)
    marker.text = text.text('text')
    return marker


def _model(owner: _Entity, namespace: str, number: int, model: Fields) -> Any:  # noqa: ANN401
    marker = _shape(Marker.MESH_RESOURCE, owner, namespace, number, model)
    marker.scale = Vector3(*model.xyz('scale'))
    marker.mesh_resource = model.text('url')
    marker.mesh_use_embedded_materials = not model.value('override_color')
    data = model.data('data')
    if len(data):
        ending = _ENDINGS.get(model.text('media_type'), 'mesh')
        name = f'model.{ending}'
        marker.mesh_resource = f'embedded://{name}'
        mesh_file: Any = TYPESTORE.types['visualization_msgs/msg/MeshFile']
        marker.mesh_file = mesh_file(name, np.frombuffer(data, np.uint8))
    return marker


_SHAPES: dict[str, tuple[str, Shape]] = {
    '': ('cubes', _cube),
    'spheres': ('spheres', _sphere),
    'cylinders': ('cylinders', _cylinder),
    'arrows': ('arrows', _arrow),
    'lines': ('lines', _line),
    'triangles': ('triangles', _triangles),
    'texts': ('texts', _text),
    'models': ('models', _model),
}
"""By the end of the namespace: the field of an entity, and what makes its markers."""


def _add_points(marker: Any, shape: Fields) -> None:  # noqa: ANN401 - a rosbags class
    """Add the points of a shape, and their colours if each has one, in the order of its indices."""
    points = [
        Point(child.number('x'), child.number('y'), child.number('z'))
        for child in shape.children('points')
    ]
    colors = [_color(child) for child in shape.children('colors')]
    indices = shape.numbers('indices')
    if len(indices):
        if not ((indices >= 0) & (indices < len(points))).all():
            raise ValueError('indices of a line are beyond its points')
        places = indices.astype(int).tolist()
        points = [points[place] for place in places]
        colors = [colors[place] for place in places if place < len(colors)]
    marker.points = points
    marker.colors = colors if len(colors) == len(points) else []


def _shape(kind: int, owner: _Entity, namespace: str, number: int, shape: Fields) -> Any:  # noqa: ANN401
    """Make a marker with the pose and the colour of a shape."""
    marker = _marker(owner, namespace, number, kind)
    marker.pose = make_pose(shape.pose('pose'))
    marker.color = _color(shape.child('color'))
    return marker


def _color(color: Fields) -> Any:  # noqa: ANN401 - a rosbags class
    return TYPESTORE.types['std_msgs/msg/ColorRGBA'](*map(color.number, 'rgba'))


def _marker(owner: _Entity, namespace: str, number: int, kind: int) -> Any:  # noqa: ANN401 - a rosbags class
    types = TYPESTORE.types
    return types['visualization_msgs/msg/Marker'](
        header=make_header(owner.stamp_ns, owner.frame_id),
        ns=namespace,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=Pose(Point(0.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)),
        scale=Vector3(0.0, 0.0, 0.0),
        color=types['std_msgs/msg/ColorRGBA'](0.0, 0.0, 0.0, 0.0),
        lifetime=types['builtin_interfaces/msg/Duration'](*to_sec_nanosec(owner.lifetime_ns)),
        frame_locked=owner.is_locked,
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
