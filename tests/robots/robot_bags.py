# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of robots from plain values, written by rosbags' and mcap's own writers."""

from __future__ import annotations

import sqlite3
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from vision_types import DETECTIONS_2D, DETECTIONS_3D

from kitti_ros2.messages.type_definitions import read_definitions

if TYPE_CHECKING:
    from pathlib import Path

LIVOX_POINT = (
    'uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line'
)
LIVOX_MESSAGE = (
    'std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n'
    'CustomPoint[] points'
)
DEFINITIONS = {
    'tf2_msgs/msg/TFMessage': 'geometry_msgs/TransformStamped[] transforms',
    'velodyne_msgs/msg/VelodynePacket': 'builtin_interfaces/Time stamp\nuint8[1206] data',
    'velodyne_msgs/msg/VelodyneScan': (
        'std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets'
    ),
    'livox_ros_driver/msg/CustomPoint': LIVOX_POINT,
    'livox_ros_driver/msg/CustomMsg': LIVOX_MESSAGE,
    'livox_ros_driver2/msg/CustomPoint': LIVOX_POINT,
    'livox_ros_driver2/msg/CustomMsg': LIVOX_MESSAGE,
    **DETECTIONS_2D,
    **DETECTIONS_3D,
}
TF_STATIC = '/tf_static'


class Said(NamedTuple):
    """A message: its topic, log time (ns), ROS 2 type and values; missing fields are zero."""

    topic: str
    log_ns: int
    msgtype: str
    values: dict


@cache
def types_of(store: Stores):
    """A typestore with the types of drivers and vision."""
    found = get_typestore(store)
    for name, text in DEFINITIONS.items():
        if name in found.fielddefs:
            continue
        if store is Stores.ROS1_NOETIC:
            text = text.replace('builtin_interfaces/Time', 'time')  # noqa: PLW2901
        found.register(get_types_from_msg(text, name))
    # Types of others are facts of their repositories, kept in the package's files.
    packages = 'autoware', 'FFMPEGPacket', 'CompressedVideo'
    known = read_definitions().items()
    found.register({name: each for name, each in known if any(word in name for word in packages)})
    return found


def made(store, msgtype, values):
    """A message of plain values."""
    fields = {}
    for name, kind in store.fielddefs[msgtype][1]:
        # ROS 1 has capitals in CameraInfo.
        fields[name] = _value(store, kind, values.get(name, values.get(name.lower())))
    return store.types[msgtype](**fields)


def _value(store, kind, value):
    node, detail = kind
    if node == Nodetype.NAME:
        return value if hasattr(value, '__msgtype__') else made(store, detail, value or {})
    if node == Nodetype.BASE:
        return ('' if detail[0] == 'string' else 0) if value is None else value
    inner, size = detail
    if inner[0] == Nodetype.BASE:
        if inner[1][0] == 'string':
            return list(value or ())
        dtype = {'bool': np.bool_, 'byte': np.uint8, 'char': np.uint8}.get(inner[1][0], inner[1][0])
        return np.zeros(size, dtype) if value is None else np.asarray(value, dtype)
    return [_value(store, inner, each) for each in value or ()]


def header(stamp_ns, frame):
    return {'stamp': {'sec': stamp_ns // 10**9, 'nanosec': stamp_ns % 10**9}, 'frame_id': frame}


def write(path: Path, said: list[Said], container: str = 'mcap', *, bare: bool = False) -> Path:
    """A bag; container is mcap, ros1 or sqlite3; bare: without definitions of types."""
    said = sorted(said, key=lambda each: each.log_ns)
    if container == 'ros1':
        return _write_ros1(path.with_suffix('.bag'), said)
    if container == 'sqlite3':
        _write_sqlite3(path, said)
        return _without_definitions(path) if bare else path
    return _write_mcap(path.with_suffix('.mcap'), said, bare=bare)


def _write_mcap(path, said, *, bare):
    store = types_of(Stores.ROS2_JAZZY)
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2')
        channels = {}
        for each in said:
            if each.topic not in channels:
                text = '' if bare else store.generate_msgdef(each.msgtype, ros_version=2)[0]
                schema = writer.register_schema(each.msgtype, 'ros2msg', text.encode())
                channels[each.topic] = writer.register_channel(each.topic, 'cdr', schema)
            data = bytes(store.serialize_cdr(made(store, each.msgtype, each.values), each.msgtype))
            writer.add_message(channels[each.topic], each.log_ns, data, each.log_ns)
        writer.finish()
    return path


def _write_sqlite3(path, said):
    store = types_of(Stores.ROS2_JAZZY)
    with Ros2Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        _write_all(writer, said, store, store.serialize_cdr)


def _without_definitions(path):
    """As recorders before Iron wrote it."""
    (file,) = path.glob('*.db3')
    connection = sqlite3.connect(file)
    with connection:
        connection.execute('DELETE FROM message_definitions')
    connection.close()
    return path


def _write_ros1(path, said):
    store = types_of(Stores.ROS1_NOETIC)
    with Ros1Writer(path) as writer:
        _write_all(writer, said, store, store.serialize_ros1)
    return path


def _write_all(writer, said, store, serialize):
    """Write messages by a writer of rosbags."""
    channels = {}
    for each in said:
        if each.topic not in channels:
            channels[each.topic] = writer.add_connection(each.topic, each.msgtype, typestore=store)
        data = serialize(made(store, each.msgtype, each.values), each.msgtype)
        writer.write(channels[each.topic], each.log_ns, data)


def transform(parent, child, matrix, stamp_ns=0):
    """A TransformStamped of a (4, 4) parent_T_child."""
    return {
        'header': header(stamp_ns, parent),
        'child_frame_id': child,
        'transform': {
            'translation': dict(zip('xyz', matrix[:3, 3].tolist(), strict=True)),
            'rotation': quaternion(matrix[:3, :3]),
        },
    }


def quaternion(rotation):
    """x y z w of a rotation whose half turn has a part w."""
    w = np.sqrt(max(1 + np.trace(rotation), 1e-12)) / 2
    x, y, z = ((rotation[b, c] - rotation[c, b]) / (4 * w) for b, c in ((2, 1), (0, 2), (1, 0)))
    return {'x': float(x), 'y': float(y), 'z': float(z), 'w': float(w)}


def pose(matrix):
    """A geometry_msgs/Pose of a (4, 4)."""
    return {
        'position': dict(zip('xyz', matrix[:3, 3].tolist(), strict=True)),
        'orientation': quaternion(matrix[:3, :3]),
    }


def place(x, y, z, rotation=None):
    """(4, 4) of a translation and a rotation."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    if rotation is not None:
        matrix[:3, :3] = rotation
    return matrix


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""The axes of an optical frame in one with x ahead, y left, z up."""


def camera_info(stamp_ns, frame, size, k, d=()):
    """A CameraInfo of rectified images without a baseline, or of a lens with D."""
    return {
        'header': header(stamp_ns, frame),
        'height': size[1],
        'width': size[0],
        'distortion_model': 'plumb_bob',
        'd': list(d) or [0.0] * 5,
        'k': np.ravel(k),
        'r': np.eye(3).ravel(),
        'p': np.column_stack([k, np.zeros(3)]).ravel(),
    }


def image(stamp_ns, frame, pixels, encoding, *, bigendian=False):
    """An Image of an array."""
    data = np.ascontiguousarray(pixels)
    return {
        'header': header(stamp_ns, frame),
        'height': data.shape[0],
        'width': data.shape[1],
        'encoding': encoding,
        'is_bigendian': int(bigendian),
        'step': data[0].nbytes,
        'data': data.reshape(-1).view(np.uint8),
    }


def scan_stamps(out: Path) -> np.ndarray:
    """(N, 3) stamps of the scans of the one drive: of each, of its start and of its end."""
    (folder,) = out.glob('*/*_sync/velodyne_points')
    texts = [(folder / f'timestamps{end}.txt').read_text() for end in ('', '_start', '_end')]
    return np.array(
        [
            [np.datetime64(line.replace(' ', 'T')).astype(int) for line in text.split('\n') if line]
            for text in texts
        ]
    ).T
