# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A robot recorded with Foxglove's schemas: in protobuf, in JSON, in ROS, and by Foxglove's SDK.

The same world is also written as ordinary ROS messages. All bags are written by the libraries of
others (mcap, mcap-protobuf-support, foxglove-schemas-protobuf, foxglove-sdk, rosbags). What is true
is computed with plain matrices.
"""

from __future__ import annotations

import importlib
import json
from base64 import b64encode
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from foxglove_types import foxglove_store
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

if TYPE_CHECKING:
    from pathlib import Path

START_NS = 1_700_000_000_250_000_001
FRAMES = 6
SIZE = (640, 360)
K = np.array([[400.0, 0, 320.5], [0, 402.0, 181.25], [0, 0, 1]])
POINT = np.dtype([(name, '<f4') for name in ('x', 'y', 'z', 'intensity', 'ring')])

AXES = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""Columns: an optical frame's x, y, z in axes x forward, y left, z up."""


def matrix(yaw: float, xyz: tuple[float, float, float], axes: np.ndarray | None = None):
    """(4, 4) of a turn about z, then the axes of a sensor, at a place."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    made = np.eye(4)
    made[:3, :3] = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
    if axes is not None:
        made[:3, :3] = made[:3, :3] @ axes
    made[:3, 3] = xyz
    return made


BASE_T_LIDAR = matrix(0.04, (0.9, 0.0, 1.8))
BASE_T_CAMERA = matrix(-0.03, (1.7, 0.1, 1.5), AXES)


def quaternion(rotation: np.ndarray) -> dict[str, float]:
    """xyzw of a rotation whose trace is not -1."""
    w = np.sqrt(max(1 + np.trace(rotation), 0)) / 2
    x, y, z = ((rotation[i, j] - rotation[j, i]) / (4 * w) for i, j in ((2, 1), (0, 2), (1, 0)))
    return {'x': float(x), 'y': float(y), 'z': float(z), 'w': float(w)}


def vector(xyz: Any) -> dict[str, float]:
    return dict(zip('xyz', map(float, xyz), strict=True))


def pose(transform: np.ndarray) -> dict[str, Any]:
    return {
        'position': vector(transform[:3, 3]),
        'orientation': quaternion(transform[:3, :3]),
    }


def time(stamp_ns: int) -> dict[str, int]:
    return dict(zip(('sec', 'nsec'), divmod(stamp_ns, 10**9), strict=True))


@dataclass(frozen=True)
class Box:
    """A box on the ground's plane, in base_link: place of the centre, yaw, size, class, track."""

    xyz: tuple[float, float, float]
    yaw: float
    size: tuple[float, float, float]
    name: str
    track: str


@dataclass(frozen=True)
class Frame:
    """What is true at one frame; points in the lidar's frame, reflectance 0..255."""

    stamp_ns: int
    points: np.ndarray
    dots: np.ndarray
    boxes: tuple[Box, ...]
    map_t_base: np.ndarray


def make_world() -> list[Frame]:
    rng = np.random.default_rng(11)
    frames = []
    for index in range(FRAMES):
        stamp_ns = START_NS + index * 100_000_000 + int(rng.integers(0, 3_000_000))
        points = np.zeros(300, POINT)
        for axis in 'xyz':
            points[axis] = rng.uniform(-2 if axis == 'z' else -25, 25, len(points))
        points['intensity'] = rng.integers(1, 256, len(points))
        points['ring'] = rng.integers(0, 32, len(points))
        dots = np.stack(np.meshgrid([8.0, 11.0], [-2.0, 0.3, 2.1], [0.4, 1.6]), -1).reshape(-1, 3)
        boxes = (
            Box((12.0 + 0.3 * index, 2.0, 0.8), 0.2, (4.2, 1.8, 1.6), 'car', 'a1b2'),
            Box((9.0, -2.5 + 0.1 * index, 0.9), -0.4, (0.7, 0.6, 1.8), 'pedestrian', 'c3'),
        )
        moved = matrix(0.02 * index, (0.8 * index, 0.02 * index, 0.0))
        frames.append(Frame(stamp_ns, points, dots, boxes, moved))
    return frames


def pixels_of(base_points: np.ndarray) -> np.ndarray:
    """(N, 2) where the camera sees points of base_link."""
    homogeneous = np.column_stack([base_points, np.ones(len(base_points))])
    seen = (np.linalg.inv(BASE_T_CAMERA) @ homogeneous.T)[:3].T @ K.T
    return seen[:, :2] / seen[:, 2:]


def jpeg(frame: Frame) -> bytes:
    image = np.full((SIZE[1], SIZE[0], 3), 30, np.uint8)
    for u, v in pixels_of(frame.dots):
        cv2.circle(image, (round(u * 16), round(v * 16)), 5 * 16, (240, 240, 240), -1, 16, 4)
    done, data = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 95])
    assert done
    return data.tobytes()


def records(world: list[Frame]) -> list[tuple[str, int, str, dict[str, Any]]]:
    """(topic, log time, schema, fields) with times as in JSON and bytes as bytes."""
    found: list[tuple[str, int, str, dict[str, Any]]] = []
    for frame in world:
        stamp = time(frame.stamp_ns)
        head = {'timestamp': stamp}
        links = [
            ('map', 'base_link', frame.map_t_base),
            ('base_link', 'lidar_top', BASE_T_LIDAR),
            ('base_link', 'cam_front', BASE_T_CAMERA),
        ]
        transforms = [
            {
                **head,
                'parent_frame_id': parent,
                'child_frame_id': child,
                'translation': vector(transform[:3, 3]),
                'rotation': quaternion(transform[:3, :3]),
            }
            for parent, child, transform in links
        ]
        fields = [
            {'name': name, 'offset': 4 * place, 'type': 7}
            for place, name in enumerate(POINT.names or ())
        ]
        entities = [
            {
                **head,
                'frame_id': 'base_link',
                'id': box.track,
                'frame_locked': True,
                'metadata': [{'key': 'category', 'value': box.name}],
                'cubes': [
                    {
                        'pose': pose(matrix(box.yaw, box.xyz)),
                        'size': vector(box.size),
                        'color': {'r': 1.0, 'g': 0.5, 'b': 0.0, 'a': 0.5},
                    }
                ],
            }
            for box in frame.boxes
        ]
        image = jpeg(frame)
        cloud = {'point_stride': POINT.itemsize, 'fields': fields, 'data': frame.points.tobytes()}
        camera = {**head, 'frame_id': 'cam_front'}
        projection = np.column_stack([K, np.zeros(3)])
        calibration = {
            **camera,
            'width': SIZE[0],
            'height': SIZE[1],
            'K': K.ravel().tolist(),
            'R': np.eye(3).ravel().tolist(),
            'P': projection.ravel().tolist(),
        }
        place = {'latitude': 49.0, 'longitude': 8.4, 'altitude': 115.0}
        messages = [
            ('/tf', 'FrameTransforms', {'transforms': transforms}),
            ('/lidar_top', 'PointCloud', {**head, 'frame_id': 'lidar_top', **cloud}),
            ('/cam_front/image', 'CompressedImage', {**camera, 'format': 'jpeg', 'data': image}),
            ('/cam_front/camera_info', 'CameraCalibration', calibration),
            ('/markers/annotations', 'SceneUpdate', {'entities': entities}),
            ('/gps', 'LocationFix', place),
        ]  # fmt: skip
        found += [(topic, frame.stamp_ns, schema, fields) for topic, schema, fields in messages]
    return found


def protobuf_type(schema: str) -> Any:
    return getattr(importlib.import_module(f'foxglove_schemas_protobuf.{schema}_pb2'), schema)


def fill(message: Any, values: dict[str, Any]) -> Any:
    """Set the fields of a protobuf message."""
    for name, value in values.items():
        if isinstance(value, dict) and 'nsec' in value:
            getattr(message, name).seconds = value['sec']
            getattr(message, name).nanos = value['nsec']
        elif isinstance(value, dict):
            getattr(message, name).SetInParent()
            fill(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for each in value:
                fill(getattr(message, name).add(), each)
        elif isinstance(value, list):
            getattr(message, name).extend(value)
        else:
            setattr(message, name, value)
    return message


def write_protobuf(path: Path, found: list[tuple[str, int, str, dict[str, Any]]]) -> Path:
    from mcap_protobuf.writer import Writer as ProtobufWriter  # noqa: PLC0415 - an extra

    with path.open('wb') as stream, ProtobufWriter(stream) as writer:
        for topic, stamp_ns, schema, fields in found:
            message = fill(protobuf_type(schema)(), fields)
            writer.write_message(topic, message, stamp_ns, stamp_ns)
    return path


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return b64encode(value).decode()
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list) else value


def write_json(path: Path, found: list[tuple[str, int, str, Any]]) -> Path:
    """As JSON; a message that is bytes is written as it is."""
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp_ns, schema, fields in found:
            if topic not in channels:
                text = json.dumps({'title': f'foxglove.{schema}', 'type': 'object'}).encode()
                number = writer.register_schema(f'foxglove.{schema}', 'jsonschema', text)
                channels[topic] = writer.register_channel(topic, 'json', number)
            data = fields if isinstance(fields, bytes) else json.dumps(_plain(fields)).encode()
            writer.add_message(channels[topic], stamp_ns, data, stamp_ns)
        writer.finish()
    return path


def write_sdk(path: Path, found: list[tuple[str, int, str, dict[str, Any]]]) -> Path:
    """By the typed channels of Foxglove's own SDK."""
    import foxglove  # noqa: PLC0415 - an extra
    from foxglove import messages as made  # noqa: PLC0415
    from foxglove.channels import SceneUpdateChannel  # noqa: F401, PLC0415 - the module is there

    nested = {
        'transforms': 'FrameTransform', 'entities': 'SceneEntity', 'cubes': 'CubePrimitive',
        'metadata': 'KeyValuePair', 'fields': 'PackedElementField', 'pose': 'Pose',
        'position': 'Vector3', 'translation': 'Vector3', 'size': 'Vector3', 'color': 'Color',
        'orientation': 'Quaternion', 'rotation': 'Quaternion', 'timestamp': 'Timestamp',
    }  # fmt: skip

    def build(name: str, values: dict[str, Any]) -> Any:
        arguments = {}
        for key, value in values.items():
            if isinstance(value, dict):
                arguments[key] = build(nested[key], value)
            elif key == 'type':
                arguments[key] = made.PackedElementFieldNumericType.Float32
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                arguments[key] = [build(nested[key], each) for each in value]
            else:
                arguments[key] = value
        return getattr(made, name)(**arguments)

    context = foxglove.Context()
    with foxglove.open_mcap(str(path), context=context):
        channels: dict[str, Any] = {}
        for topic, stamp_ns, schema, fields in found:
            if topic not in channels:
                kind = getattr(foxglove.channels, f'{schema}Channel')
                channels[topic] = kind(topic, context=context)
            channels[topic].log(build(schema, fields), log_time=stamp_ns)
    return path


def write_foxglove_msgs(
    path: Path,
    found: list[tuple[str, int, str, dict[str, Any]]],
    storage: StoragePlugin = StoragePlugin.MCAP,
) -> Path:
    """As foxglove_msgs in CDR, in a bag of rosbag2."""
    store = foxglove_store()
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for topic, stamp_ns, schema, fields in found:
            kind = f'foxglove_msgs/msg/{schema}'
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            message = _ros_message(store, kind, fields)
            writer.write(connections[topic], stamp_ns, store.serialize_cdr(message, kind))
    return path


def _ros_message(store: Any, kind: str, values: dict[str, Any]) -> Any:
    values = {name.lower(): value for name, value in values.items()}
    if 'nsec' in values:
        values = {'sec': values['sec'], 'nanosec': values['nsec']}
    made = {
        name: _ros_value(store, form, values.get(name)) for name, form in store.fielddefs[kind][1]
    }
    return store.types[kind](**made)


def _ros_value(store: Any, form: Any, value: Any) -> Any:
    node, detail = form
    if node == Nodetype.NAME:
        return _ros_message(store, detail, value or {})
    if node == Nodetype.BASE:
        empty = {'string': '', 'bool': False}.get(detail[0], 0)
        return empty if value is None else value
    element, size = detail
    if element[0] == Nodetype.NAME:
        return [_ros_message(store, element[1], each) for each in value or ()]
    if isinstance(value, bytes):
        return np.frombuffer(value, np.uint8)
    kind = {'float64': np.float64, 'uint8': np.uint8, 'uint32': np.uint32}[element[1][0]]
    return np.zeros(size, kind) if value is None else np.array(value, kind)


def write_ros(path: Path, world: list[Frame], *topics: str) -> Path:
    """The same world as the ordinary messages of ROS 2 Jazzy, all topics or some."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for frame in world:
            for topic, message in _ros_messages(store.types, frame):
                if topics and topic not in topics:
                    continue
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                data = store.serialize_cdr(message, kind)
                writer.write(connections[topic], frame.stamp_ns, data)
    return path


def _ros_messages(types: Any, frame: Frame) -> list[tuple[str, Any]]:
    def made(kind: str, *values: Any) -> Any:
        package, name = kind.split('/')
        return types[f'{package}/msg/{name}'](*values)

    def header(frame_id: str) -> Any:
        stamp = made('builtin_interfaces/Time', *divmod(frame.stamp_ns, 10**9))
        return made('std_msgs/Header', stamp, frame_id)

    def turned(rotation: np.ndarray) -> Any:
        return made('geometry_msgs/Quaternion', *quaternion(rotation).values())

    def placed(transform: np.ndarray) -> Any:
        place = made('geometry_msgs/Vector3', *map(float, transform[:3, 3]))
        return made('geometry_msgs/Transform', place, turned(transform[:3, :3]))

    links = [
        ('map', 'base_link', frame.map_t_base),
        ('base_link', 'lidar_top', BASE_T_LIDAR),
        ('base_link', 'cam_front', BASE_T_CAMERA),
    ]
    tf = [
        made('geometry_msgs/TransformStamped', header(parent), child, placed(transform))
        for parent, child, transform in links
    ]
    fields = [
        made('sensor_msgs/PointField', name, 4 * place, 7, 1)
        for place, name in enumerate(POINT.names or ())
    ]
    data = np.frombuffer(frame.points.tobytes(), np.uint8)
    count = len(frame.points)
    cloud = made(
        'sensor_msgs/PointCloud2', header('lidar_top'), 1, count, fields, False,
        POINT.itemsize, len(data), data, False,
    )  # fmt: skip
    picture = np.frombuffer(jpeg(frame), np.uint8)
    image = made('sensor_msgs/CompressedImage', header('cam_front'), 'jpeg', picture)
    projection = np.column_stack([K, np.zeros(3)])
    info = made(
        'sensor_msgs/CameraInfo', header('cam_front'), SIZE[1], SIZE[0], '', np.zeros(0),
        K.ravel(), np.eye(3).ravel(), projection.ravel(), 0, 0,
        made('sensor_msgs/RegionOfInterest', 0, 0, 0, 0, False),
    )  # fmt: skip
    nothing = np.zeros(0, np.uint8)
    markers = []
    for box in frame.boxes:
        transform = matrix(box.yaw, box.xyz)
        center = made(
            'geometry_msgs/Pose',
            made('geometry_msgs/Point', *map(float, box.xyz)),
            turned(transform[:3, :3]),
        )
        markers.append(
            made(
                'visualization_msgs/Marker', header('base_link'), box.track, 0, 1, 0, center,
                made('geometry_msgs/Vector3', *box.size),
                made('std_msgs/ColorRGBA', 1.0, 0.5, 0.0, 0.5),
                made('builtin_interfaces/Duration', 0, 0), False, [], [], '',
                made('sensor_msgs/CompressedImage', header(''), '', nothing), [], box.name, '',
                made('visualization_msgs/MeshFile', '', nothing), False,
            )
        )  # fmt: skip
    status = made('sensor_msgs/NavSatStatus', 0, 1)
    fix = made('sensor_msgs/NavSatFix', header(''), status, 49.0, 8.4, 115.0, np.zeros(9), 0)
    return [
        ('/tf', made('tf2_msgs/TFMessage', tf)),
        ('/lidar_top', cloud),
        ('/cam_front/image', image),
        ('/cam_front/camera_info', info),
        ('/markers/annotations', made('visualization_msgs/MarkerArray', markers)),
        ('/gps', fix),
    ]
