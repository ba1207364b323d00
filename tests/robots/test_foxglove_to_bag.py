# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with Foxglove's schemas become bags of ROS 2, with the same values."""

from __future__ import annotations

import base64
import json
from collections import Counter

import foxglove_robot as robot
import numpy as np
import nuscenes_mcap
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main

START_NS = 1_317_042_145_951_199_337
STAMP = {'sec': 1_317_042_140, 'nsec': 5}


def convert(source, out, *words):
    return main(['to-bag', str(source), str(out), '-q', *words])


def write_json(path, schema, message, topic='/topic'):
    """An MCAP file with one message in JSON."""
    with path.open('wb') as file:
        writer = McapWriter(file)
        writer.start()
        number = writer.register_schema(schema, 'jsonschema', b'{}')
        channel = writer.register_channel(topic, 'json', number)
        writer.add_message(channel, START_NS, json.dumps(message).encode(), START_NS)
        writer.finish()
    return path


def converted(tmp_path, schema, message):
    """The type of the one message in the new bag, and the message by rosbags."""
    bag = write_json(tmp_path / 'bag.mcap', schema, message)
    assert convert(bag, tmp_path / 'out') == 0
    with AnyReader([tmp_path / 'out']) as reader:
        ((connection, stamp_ns, data),) = reader.messages()
        assert stamp_ns == START_NS
        return connection.msgtype, reader.deserialize(data, connection.msgtype)


DATA = base64.b64encode(bytes(range(12))).decode()
HEAD = {'timestamp': STAMP, 'frame_id': 'lidar'}
SCHEMAS = {
    'CompressedImage': ('sensor_msgs/msg/CompressedImage', {'format': 'png', 'data': DATA}),
    'RawImage': (
        'sensor_msgs/msg/Image',
        {'width': 4, 'height': 1, 'step': 12, 'encoding': 'rgb8', 'data': DATA},
    ),
    'CameraCalibration': ('sensor_msgs/msg/CameraInfo', {'width': 4, 'height': 2, 'K': [1.0] * 9}),
    'PointCloud': (
        'sensor_msgs/msg/PointCloud2',
        {'point_stride': 4, 'fields': [{'name': 'x', 'offset': 0, 'type': 7}], 'data': DATA},
    ),
    'LocationFix': ('sensor_msgs/msg/NavSatFix', {'latitude': 49.0}),
    'PoseInFrame': ('geometry_msgs/msg/PoseStamped', {'pose': {'position': {'x': 2.0}}}),
    'Odometry': ('nav_msgs/msg/Odometry', {'body_frame_id': 'base'}),
    'FrameTransform': ('tf2_msgs/msg/TFMessage', {'parent_frame_id': 'a', 'child_frame_id': 'b'}),
    'SceneUpdate': ('visualization_msgs/msg/MarkerArray', {'entities': [HEAD]}),
    'Grid': (
        'foxglove_msgs/msg/Grid',
        {'column_count': 3, 'cell_size': {'x': 0.5}, 'row_stride': 6, 'data': DATA},
    ),
    'Log': ('foxglove_msgs/msg/Log', {'level': 3, 'message': 'hot', 'line': 7}),
    'GeoJSON': ('foxglove_msgs/msg/GeoJSON', {'geojson': '{}'}),
    'CompressedVideo': ('foxglove_msgs/msg/CompressedVideo', {'format': 'h264', 'data': DATA}),
    'ImageAnnotations': (
        'foxglove_msgs/msg/ImageAnnotations',
        {'points': [{'type': 2, 'points': [{'x': 1, 'y': 2}], 'outline_color': {'r': 1}}]},
    ),
}


@pytest.mark.parametrize('schema', SCHEMAS)
def test_a_schema_becomes_its_type_in_ros_2(schema, tmp_path):
    expected, fields = SCHEMAS[schema]
    msgtype, message = converted(tmp_path, f'foxglove.{schema}', {**HEAD, **fields})
    assert msgtype == expected
    if hasattr(message, 'header'):
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (STAMP['sec'], 5)
        assert message.header.frame_id == 'lidar'
    if schema == 'Grid':
        assert (message.timestamp.sec, message.column_count) == (STAMP['sec'], 3)
        assert (message.cell_size.x, message.pose.orientation.w) == (0.5, 1.0)
    if schema == 'Log':
        assert (message.level, message.message, message.line) == (3, 'hot', 7)
    if schema == 'ImageAnnotations':
        (loop,) = message.points
        assert (loop.type, loop.points[0].y, loop.outline_color.r) == (2, 2.0, 1.0)
    if 'data' in fields:
        assert np.asarray(message.data).tobytes() == bytes(range(12))


def test_every_shape_of_a_scene_becomes_a_marker(tmp_path):
    points = [{'x': 0.0}, {'x': 1.0}, {'y': 1.0}]
    entity = {
        **HEAD,
        'id': 'a',
        'lifetime': {'sec': 2, 'nsec': 3},
        'frame_locked': True,
        'metadata': [{'key': 'category', 'value': 'car'}],
        'cubes': [{'size': {'x': 4.0, 'y': 2.0, 'z': 1.5}, 'color': {'g': 1.0}}],
        'spheres': [{'size': {'x': 1.0, 'y': 1.0, 'z': 1.0}}],
        'cylinders': [{'size': {'x': 1.0, 'y': 1.0, 'z': 2.0}}],
        'arrows': [{'shaft_length': 2.0, 'head_length': 0.5, 'shaft_diameter': 0.1}],
        'lines': [
            {'type': 0, 'thickness': 0.2, 'points': points},
            {'type': 1, 'thickness': 3, 'scale_invariant': True, 'points': points},
            {'type': 2, 'points': points, 'indices': [2, 0]},
        ],
        'triangles': [{'points': points, 'colors': [{'r': 0.5}] * 3}],
        'texts': [{'text': 'hello', 'font_size': 0.7}],
        'models': [{'url': 'package://x/y.glb'}, {'data': DATA, 'media_type': 'model/stl'}],
    }
    deletions = [{'type': 1}, {'type': 0, 'id': 'b'}]
    _, array = converted(
        tmp_path, 'foxglove.SceneUpdate', {'entities': [entity], 'deletions': deletions}
    )
    removed = [marker for marker in array.markers if marker.action]
    assert (removed[0].action, removed[1].action) == (3, 2)
    assert {marker.ns for marker in removed[1:]} >= {'b', 'b/lines', 'b/texts'}
    made = {(marker.ns, marker.id): marker for marker in array.markers if not marker.action}
    kinds = {key: marker.type for key, marker in made.items()}
    assert kinds == {
        ('a', 0): 1,
        ('a/spheres', 0): 2,
        ('a/cylinders', 0): 3,
        ('a/arrows', 0): 0,
        ('a/lines', 0): 4,
        ('a/lines', 1): 4,
        ('a/lines', 2): 5,
        ('a/triangles', 0): 11,
        ('a/texts', 0): 9,
        ('a/models', 0): 10,
        ('a/models', 1): 10,
    }
    cube = made['a', 0]
    assert (cube.text.split('\n')[0], cube.scale.x, cube.color.g) == ('car', 4.0, 1.0)
    assert (cube.lifetime.sec, cube.lifetime.nanosec, cube.frame_locked) == (2, 3, True)
    assert made['a/arrows', 0].points[1].x == 2.5
    assert [len(made['a/lines', number].points) for number in range(3)] == [3, 4, 2]
    assert [made['a/lines', number].scale.x for number in range(2)] == [0.2, 0.05]
    assert made['a/lines', 2].points[0].y == 1.0
    assert [color.r for color in made['a/triangles', 0].colors] == [0.5] * 3
    assert (made['a/texts', 0].text, made['a/texts', 0].scale.z) == ('hello', 0.7)
    assert made['a/models', 0].mesh_resource == 'package://x/y.glb'
    assert made['a/models', 1].mesh_resource == 'embedded://model.stl'
    assert made['a/models', 1].mesh_file.data.tobytes() == bytes(range(12))


def test_what_is_not_of_foxglove_is_named_and_the_rest_is_written(tmp_path, capsys):
    pytest.importorskip('mcap_protobuf')
    pytest.importorskip('foxglove_schemas_protobuf')
    records = nuscenes_mcap.records(nuscenes_mcap.make_sweeps())
    bag = nuscenes_mcap.write(tmp_path / 'bag.mcap', records)
    assert convert(bag, tmp_path / 'out') == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 2
    assert '/imu is json, which is not read' in said
    expected = Counter(topic for topic, _, schema, _ in records if not schema.startswith('json '))
    with open_messages(tmp_path / 'out') as messages:
        assert Counter(message.topic for message in messages) == expected


@pytest.mark.parametrize(
    ('topic', 'valid'),
    [
        ('/a/b_1', True),
        ('a', True),
        ('/a b', False),
        ('/1', False),
        ('/a__b', False),
        ('/a/', False),
    ],
)
def test_a_topic_that_ros_2_cannot_play_is_named(topic, valid, tmp_path, capsys):
    bag = write_json(tmp_path / 'bag.mcap', 'foxglove.Log', HEAD, topic)
    assert main(['to-bag', str(bag), str(tmp_path / 'out')]) == 0
    assert (f'{topic} is no valid topic' in capsys.readouterr().out) != valid


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_messages_of_foxglove_msgs_keep_their_type_and_their_bytes(plugin, tmp_path):
    bag = robot.write_foxglove_msgs(tmp_path / 'bag', robot.records(robot.make_world()), plugin)
    assert convert(bag, tmp_path / 'out') == 0
    with AnyReader([bag]) as before, AnyReader([tmp_path / 'out']) as after:
        rows = [
            [(each.topic, each.msgtype, ns, bytes(data)) for each, ns, data in reader.messages()]
            for reader in (before, after)
        ]
    assert rows[0] == rows[1]
    assert any('foxglove_msgs' in msgtype for _, msgtype, _, _ in rows[0])


def test_a_set_of_the_new_bag_is_that_of_the_old_one(tmp_path):
    pytest.importorskip('mcap_protobuf')
    pytest.importorskip('foxglove_schemas_protobuf')
    bag = robot.write_protobuf(tmp_path / 'bag.mcap', robot.records(robot.make_world()))
    assert convert(bag, tmp_path / 'out.bag') == 0
    for source, name in ((bag, 'expected'), (tmp_path / 'out.bag', 'set')):
        out = tmp_path / name
        assert main(['to-kitti', str(source), str(out), '--layout', 'object', '-q']) == 0
    files = [path for path in (tmp_path / 'expected').rglob('*') if path.is_file()]
    assert len(files) > robot.FRAMES
    for path in files:
        assert (
            path.read_bytes()
            == (tmp_path / 'set' / path.relative_to(tmp_path / 'expected')).read_bytes()
        )
