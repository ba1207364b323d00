# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags with Foxglove's schemas become the same KITTI sets as ROS messages of the same content."""

from __future__ import annotations

import json
import sys
from hashlib import sha256

import foxglove_robot as robot
import numpy as np
import pytest
from builders import OF_OTHERS
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin

from kitti_ros2.bags.open_source import open_bag_source
from kitti_ros2.bags.reader import BagMessages, open_messages, summarize_bag
from kitti_ros2.cli import main
from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.foxglove_fields import JsonFields
from kitti_ros2.model.errors import KittiRos2Error
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.own_bags.to_kitti import propose_plan

pytest.importorskip('mcap_protobuf')
pytest.importorskip('foxglove_schemas_protobuf')

WORLD = robot.make_world()
RECORDS = robot.records(WORLD)
ENCODINGS = {
    'protobuf': robot.write_protobuf,
    'json': robot.write_json,
    'sdk': robot.write_sdk,
    'foxglove_msgs': robot.write_foxglove_msgs,
    'foxglove_msgs in sqlite3': lambda path, found: robot.write_foxglove_msgs(
        path.with_suffix(''), found, StoragePlugin.SQLITE3
    ),
}


def convert(bag, out, layout):
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    return convert_by_plan([bag], guess([bag], survey, options).plan, survey, out, options)


def files_of(folder):
    return {
        str(path.relative_to(folder)): sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob('*'))
        if path.is_file()
    }


@pytest.fixture(scope='module')
def ros_bag(tmp_path_factory):
    return robot.write_ros(tmp_path_factory.mktemp('ros') / 'bag', WORLD)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', OF_OTHERS, ids=[layout.value for layout in OF_OTHERS])
@pytest.mark.parametrize('write', ENCODINGS.values(), ids=ENCODINGS)
def test_the_set_is_that_of_ros_messages_byte_for_byte(tmp_path, ros_bag, write, layout):
    bag = write(tmp_path / 'bag.mcap', RECORDS)
    report = convert(bag, tmp_path / 'out', layout)
    assert report.losses == ()
    convert(ros_bag, tmp_path / 'expected', layout)
    made = files_of(tmp_path / 'out')
    assert made == files_of(tmp_path / 'expected')
    assert len(made) > robot.FRAMES


def test_a_bag_with_some_topics_in_ros_is_the_same(tmp_path, ros_bag):
    """Topics of both kinds, in two files of one recording."""
    ros_topics = {'/lidar_top', '/gps'}
    found = [record for record in RECORDS if record[0] not in ros_topics]
    robot.write_protobuf(tmp_path / 'foxglove.mcap', found)
    robot.write_ros(tmp_path / 'ros', WORLD, *ros_topics)
    bags = [tmp_path / 'foxglove.mcap', tmp_path / 'ros']
    options, survey = ImportOptions(layout=Layout.OBJECT), survey_bags(bags)
    plan = guess(bags, survey, options).plan
    convert_by_plan(bags, plan, survey, tmp_path / 'out', options)
    convert(ros_bag, tmp_path / 'expected', Layout.OBJECT)
    assert files_of(tmp_path / 'out') == files_of(tmp_path / 'expected')


def test_points_boxes_and_dots_are_true(tmp_path):
    bag = robot.write_protobuf(tmp_path / 'bag.mcap', RECORDS)
    convert(bag, tmp_path / 'out', Layout.OBJECT)
    recording = open_recording(tmp_path / 'out')
    lidar_t_base = np.linalg.inv(robot.BASE_T_LIDAR)
    for number, frame in enumerate(WORLD):
        points = recording.read(Stream.SCAN, number).points
        expected = np.column_stack([frame.points[name] for name in ('x', 'y', 'z', 'intensity')])
        np.testing.assert_allclose(points[:, :3], expected[:, :3], atol=1e-5)
        np.testing.assert_allclose(points[:, 3], expected[:, 3] / 255, atol=1e-6)
        calibration = recording.read(Stream.CALIBRATION, number)
        dots = np.column_stack([frame.dots, np.ones(len(frame.dots))])
        in_lidar = (lidar_t_base @ dots.T)[:3].T
        rect = calibration.r0_rect @ calibration.cam0_T_velo.apply(in_lidar).T
        seen = (calibration.cameras[2].p_rect @ np.vstack([rect, np.ones(rect.shape[1])])).T
        expected_pixels = robot.pixels_of(frame.dots)
        assert np.abs(seen[:, :2] / seen[:, 2:] - expected_pixels).max() < 0.01
        lines = (tmp_path / 'out/training/label_2' / f'{number:06}.txt').read_text().splitlines()
        labels = {line.split()[0].lower(): np.array(line.split()[8:15], float) for line in lines}
        assert set(labels) == {box.name for box in frame.boxes}
        signs = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1)
        for box in frame.boxes:
            corners = np.vstack([signs * np.array(box.size)[:, None], np.ones(8)])
            base_t_box = robot.matrix(box.yaw, box.xyz)
            expected = (np.linalg.inv(robot.BASE_T_CAMERA) @ base_t_box @ corners)[:3].T
            made = label_corners(*labels[box.name])
            gaps = np.linalg.norm(made[:, None] - expected[None], axis=2).min(axis=1)
            assert gaps.max() < 1e-4


def label_corners(height, width, length, x, y, z, rotation_y):
    """(8, 3) by the readme of KITTI's development kit: (x, y, z) is the middle of the bottom."""
    cos, sin = np.cos(rotation_y), np.sin(rotation_y)
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    signs = np.array(np.meshgrid([-0.5, 0.5], [-1, 0], [-0.5, 0.5])).reshape(3, -1)
    return (turn @ (signs * [[length], [height], [width]])).T + np.array([x, y, z])


def test_the_summary_names_the_types_of_ros(tmp_path):
    summary = summarize_bag(robot.write_json(tmp_path / 'bag.mcap', RECORDS))
    assert {topic.name: topic.msgtype for topic in summary.topics} == {
        '/cam_front/camera_info': 'sensor_msgs/msg/CameraInfo',
        '/cam_front/image': 'sensor_msgs/msg/CompressedImage',
        '/gps': 'sensor_msgs/msg/NavSatFix',
        '/lidar_top': 'sensor_msgs/msg/PointCloud2',
        '/markers/annotations': 'visualization_msgs/msg/MarkerArray',
        '/tf': 'tf2_msgs/msg/TFMessage',
    }
    assert summary.complete


def test_a_message_without_a_time_has_its_log_time(tmp_path):
    bag = robot.write_protobuf(tmp_path / 'bag.mcap', RECORDS)
    fixes = [message for message in read(bag) if message.__msgtype__.endswith('NavSatFix')]
    stamps = [fix.header.stamp.sec * 10**9 + fix.header.stamp.nanosec for fix in fixes]
    assert stamps == [frame.stamp_ns for frame in WORLD]


def read(bag):
    """All messages, decoded."""
    with open_messages(bag) as messages:
        return [
            messages.typestore.deserialize_cdr(message.data, message.msgtype)
            for message in messages
        ]


def one(tmp_path, schema, fields, write=robot.write_protobuf):
    """The one message that a bag of one message becomes."""
    found = [('/topic', robot.START_NS, schema, fields)]
    (message,) = read(write(tmp_path / 'bag.mcap', found))
    return message


WRITERS = pytest.mark.parametrize('write', [robot.write_protobuf, robot.write_json])


@WRITERS
def test_a_pose_of_a_cloud_is_applied_to_its_points(tmp_path, write):
    frame = WORLD[0]
    moved = robot.matrix(0.5, (1.0, 2.0, -3.0))
    fields = [{'name': name, 'offset': 4 * at, 'type': 7} for at, name in enumerate('xyz')]
    xyz = np.column_stack([frame.points[name] for name in 'xyz'])
    cloud = {'pose': robot.pose(moved), 'point_stride': 12, 'fields': fields}
    made = one(tmp_path, 'PointCloud', {**cloud, 'data': xyz.tobytes()}, write)
    expected = xyz @ moved[:3, :3].T + moved[:3, 3]
    np.testing.assert_allclose(made.data.view('<f4').reshape(-1, 3), expected, atol=1e-5)
    assert (made.width, made.point_step) == (len(xyz), 12)


@WRITERS
def test_a_laser_scan_has_the_angle_of_each_return(tmp_path, write):
    ranges = [1.0, 2.5, 4.0, 0.5]
    fields = {'frame_id': 'laser', 'start_angle': -1.5, 'end_angle': 1.5, 'ranges': ranges}
    made = one(tmp_path, 'LaserScan', {**fields, 'intensities': [9.0, 8, 7, 6]}, write)
    assert made.__msgtype__ == 'sensor_msgs/msg/LaserScan'
    assert (made.header.frame_id, made.angle_min, made.angle_max) == ('laser', -1.5, 1.5)
    assert made.angle_increment == 1.0
    assert made.ranges.tolist() == ranges
    assert made.intensities.tolist() == [9, 8, 7, 6]


@WRITERS
def test_a_raw_image_keeps_its_encoding(tmp_path, write):
    data = bytes(range(24))
    fields = {'width': 4, 'height': 2, 'encoding': 'rgb8', 'step': 12, 'data': data}
    made = one(tmp_path, 'RawImage', fields, write)
    assert (made.width, made.height, made.encoding, made.step) == (4, 2, 'rgb8', 12)
    assert made.data.tobytes() == data


@WRITERS
def test_poses_and_odometry(tmp_path, write):
    place = robot.pose(robot.matrix(0.3, (1.0, 2.0, 3.0)))
    made = one(tmp_path, 'PoseInFrame', {'frame_id': 'map', 'pose': place}, write)
    assert made.__msgtype__ == 'geometry_msgs/msg/PoseStamped'
    assert (made.header.frame_id, made.pose.position.y) == ('map', 2.0)
    assert made.pose.orientation.z == pytest.approx(np.sin(0.15))
    odometry = {'frame_id': 'odom', 'body_frame_id': 'base', 'pose': place}
    velocity = {'linear_velocity': robot.vector((4, 5, 6))}
    made = one(tmp_path, 'Odometry', {**odometry, **velocity}, write)
    assert (made.child_frame_id, made.pose.pose.position.z) == ('base', 3.0)
    assert made.twist.twist.linear.x == 4.0
    made = one(tmp_path, 'PosesInFrame', {'frame_id': 'map', 'poses': [place, place]}, write)
    assert made.__msgtype__ == 'geometry_msgs/msg/PoseArray'
    assert [pose.position.x for pose in made.poses] == [1.0, 1.0]


def test_a_quaternion_of_zeros_is_no_turn(tmp_path):
    """As some exporters write a rotation that they leave out."""
    zeros = {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 0.0}
    fields = {'parent_frame_id': 'a', 'child_frame_id': 'b', 'rotation': zeros}
    made = one(tmp_path, 'FrameTransform', fields, robot.write_json)
    assert made.transforms[0].transform.rotation.w == 1.0


def test_a_scene_has_classes_of_metadata_or_texts_and_deletions(tmp_path):
    cube = {'size': robot.vector((4, 2, 1.5))}
    scene = {
        'deletions': [{'type': 1}],
        'entities': [
            {'id': 'a', 'metadata': [{'key': 'Category', 'value': 'vehicle.car'}], 'cubes': [cube]},
            {'id': 'b', 'texts': [{'text': 'Ped 0.8'}], 'cubes': [cube, cube]},
            {
                'id': 'c',
                'lines': [{'type': 2, 'points': [robot.vector((0, 0, k)) for k in (1, 2)]}],
            },
        ],
    }
    made = one(tmp_path, 'SceneUpdate', scene).markers
    assert [marker.action for marker in made] == [3, 0, 0, 0, 0]
    assert [(marker.ns, marker.id, marker.text) for marker in made[1:]] == [
        ('a', 0, 'vehicle.car'),
        ('b', 0, 'Ped 0.8'),
        ('b', 1, 'Ped 0.8'),
        ('c', 0, ''),
    ]
    assert [marker.type for marker in made[1:]] == [1, 1, 1, 5]
    assert len(made[4].points) == 2


CLOUD = {'point_stride': 12, 'fields': [{'name': 'x', 'offset': 0, 'type': 7}]}
DAMAGED = {
    'no JSON': b'{"timestamp"',
    'nested': b'[' * 200_000,
    'nested objects': b'{"pose":' * 200_000,
    'not an object': b'[1, 2]',
    'no text': b'\xff\xfe\x00',
    'a stride of text': {'point_stride': '12'},
    'a negative stride': {'point_stride': -12},
    'half a stride': {'point_stride': 1.5},
    'too short': {**CLOUD, 'data': bytes(11)},
    'no stride': {'point_stride': 0, 'data': bytes(12)},
    'beyond the stride': {
        'point_stride': 12,
        'fields': [{'name': 'x', 'offset': 9, 'type': 7}],
        'data': bytes(12),
    },
    'an unknown type': {
        'point_stride': 12,
        'fields': [{'name': 'x', 'offset': 0, 'type': 99}],
        'data': bytes(12),
    },
    'no base64': {**CLOUD, 'data': 'not base64!'},
    'a list of fields': {'fields': {'name': 'x'}},
    'a field that is none': {'fields': [3]},
    'a pose that is none': {**CLOUD, 'pose': {'position': {'x': float('nan')}}},
    'a time of text': {'timestamp': '2024-01-01T00:00:00Z'},
    'a time before 1970': {'timestamp': {'sec': -1, 'nsec': 0}},
    'a number of many digits': b'{"point_stride": ' + b'9' * 10_000 + b'}',
    'infinity': b'{"point_stride": Infinity}',
}


@pytest.mark.parametrize('fields', DAMAGED.values(), ids=DAMAGED)
def test_a_damaged_message_is_lost_alone(tmp_path, fields):
    whole = RECORDS[1][3]
    found = [
        ('/lidar_top', robot.START_NS + at, 'PointCloud', each)
        for at, each in enumerate([whole, fields, whole])
    ]
    with open_messages(robot.write_json(tmp_path / 'bag.mcap', found)) as messages:
        assert len(list(messages)) == 2
        (loss,) = messages.losses.items()
    assert loss[1] == 1
    assert '/lidar_top' in loss[0]
    assert 'Traceback' not in loss[0]
    assert len(loss[0].splitlines()) == 1


def test_damaged_protobuf_is_lost_alone(tmp_path):
    schema = robot.protobuf_type('PointCloud')
    from mcap_protobuf.schema import build_file_descriptor_set  # noqa: PLC0415 - an extra

    definition = build_file_descriptor_set(schema).SerializeToString()
    whole = robot.fill(schema(), RECORDS[1][3]).SerializeToString()
    path = write_raw(tmp_path, 'foxglove.PointCloud', definition, whole, b'\x0a\xff\xff', whole)
    with open_messages(path) as messages:
        assert len(list(messages)) == 2
        assert list(messages.losses.values()) == [1]
        assert 'no protobuf message of its schema' in next(iter(messages.losses))


@pytest.mark.parametrize('definition', [b'', b'\x00\x01', b'\x0a\x05abc'])
def test_a_damaged_schema_costs_its_topic_only(tmp_path, definition):
    path = write_raw(tmp_path, 'foxglove.PointCloud', definition, b'')
    with open_messages(path) as messages:
        assert list(messages) == []
        assert list(messages.losses.values()) == [1]
        assert '/lidar_top cannot be read: its schema' in next(iter(messages.losses))


def write_raw(tmp_path, name, definition, *messages):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start()
        schema = writer.register_schema(name, 'protobuf', definition)
        channel = writer.register_channel('/lidar_top', 'protobuf', schema)
        for stamp, data in enumerate(messages):
            writer.add_message(channel, robot.START_NS + stamp, data, robot.START_NS + stamp)
        writer.finish()
    return path


def test_schemas_that_are_no_ros_messages_are_named(tmp_path):
    found = [
        *RECORDS,
        ('/log', robot.START_NS, 'Log', {'message': 'on'}),
        ('/map', robot.START_NS, 'Grid', {'frame_id': 'map'}),
    ]
    path = robot.write_protobuf(tmp_path / 'bag.mcap', found)
    with open_messages(path) as messages:
        assert messages.problems == (
            f'{path}: /log is foxglove.Log in protobuf, which is not read',
            f'{path}: /map is foxglove.Grid in protobuf, which is not read',
        )
        assert [loss.count for _, loss in messages.left_out] == [1, 1]


def test_the_plan_gives_one_reason_for_them(tmp_path):
    found = [*RECORDS, ('/map', robot.START_NS, 'Grid', {'frame_id': 'map'})]
    path = robot.write_protobuf(tmp_path / 'bag.mcap', found)
    notes = propose_plan([open_bag_source(path)], ImportOptions(layout=Layout.OBJECT)).notes
    lines = [note for note in notes if '/map' in note]
    assert len(lines) == 2
    assert 'foxglove.Grid in protobuf, which is not read' in ' '.join(lines)
    assert 'definition' not in ' '.join(lines)


def test_a_copy_keeps_the_messages_as_stored(tmp_path):
    path = robot.write_foxglove_msgs(tmp_path / 'bag', RECORDS)
    with BagMessages([path], as_stored=True) as messages:
        assert dict(messages.channels)['/lidar_top'] == 'foxglove_msgs/msg/PointCloud'
        assert len(list(messages)) == len(RECORDS)


def test_protobuf_without_its_library_says_what_to_install(tmp_path, monkeypatch, capsys):
    path = robot.write_protobuf(tmp_path / 'bag.mcap', RECORDS)
    monkeypatch.setitem(sys.modules, 'mcap_protobuf.decoder', None)
    with pytest.raises(KittiRos2Error, match=r"run pip install 'kitti_ros2\[foxglove\]'$"):
        open_messages(path)
    assert main(['to-kitti', str(path), str(tmp_path / 'out')]) != 0
    error = capsys.readouterr().err.strip()
    assert error.splitlines()[-1].endswith("run pip install 'kitti_ros2[foxglove]'")
    assert not (tmp_path / 'out').exists()
    robot.write_ros(tmp_path / 'ros', WORLD, '/lidar_top')
    found = [record for record in RECORDS if record[0] != '/lidar_top']
    mixed = [robot.write_protobuf(tmp_path / 'some.mcap', found), tmp_path / 'ros']
    with open_messages(mixed) as messages:
        assert {message.topic for message in messages} == {'/lidar_top'}
        assert sum(messages.losses.values()) == len(found)


def test_json_needs_no_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'mcap_protobuf.decoder', None)
    assert len(read(robot.write_json(tmp_path / 'bag.mcap', RECORDS))) == len(RECORDS)


def test_a_type_that_the_bag_defines_otherwise_is_not_mixed_up(tmp_path):
    """Messages made by this package have the fields of ROS 2 Jazzy."""
    path = tmp_path / 'bag.mcap'
    old = 'builtin_interfaces/Time stamp\nstring frame_id\nstring more'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start()
        schema = writer.register_schema('std_msgs/msg/Header', 'ros2msg', old.encode())
        writer.register_channel('/header', 'cdr', schema)
        schema = writer.register_schema('foxglove.PoseInFrame', 'jsonschema', b'{}')
        channel = writer.register_channel('/pose', 'json', schema)
        writer.add_message(channel, 1, json.dumps({'frame_id': 'map'}).encode(), 1)
        writer.finish()
    with open_messages(path) as messages:
        assert list(messages) == []
        (loss,) = messages.losses
    assert 'defines std_msgs/msg/Header otherwise than ROS 2 Jazzy' in loss


@pytest.mark.parametrize(
    'read', [lambda fields: fields.number('x'), lambda fields: fields.numbers('xs')]
)
def test_a_huge_number_is_no_number(read):
    with pytest.raises(ValueError, match=r'expected a (number|list of numbers)'):
        read(JsonFields({'x': 10**400, 'xs': [10**400]}))
