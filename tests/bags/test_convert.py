# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag of any container becomes a bag of any other, with the same values, times and QoS."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
import yaml
from bag_samples import random_message
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.cli import main

START_NS = 1_317_042_145_951_199_337
OWN = 'robot_msgs/msg/Wheels'
OWN_TEXT = 'uint8 front_left = 0\nstd_msgs/Header header\nfloat64[4] Speeds\nstring[] names\n'
TOPICS = {
    '/camera_info': ('sensor_msgs/msg/CameraInfo', False),
    '/imu': ('sensor_msgs/msg/Imu', False),
    '/points': ('sensor_msgs/msg/PointCloud2', False),
    '/tf_static': ('tf2_msgs/msg/TFMessage', True),
    '/map': ('nav_msgs/msg/OccupancyGrid', True),
    '/markers': ('visualization_msgs/msg/MarkerArray', False),
    '/wheels': (OWN, False),
}
OUTS = {'mcap file': 'out.mcap', 'mcap': 'out', 'sqlite3': 'out', 'ros1': 'out.bag'}
STORAGE = {'sqlite3': ['--storage', 'sqlite3']}


def store_of(version):
    store = get_typestore(version)
    text = (
        OWN_TEXT
        if version == Stores.ROS1_NOETIC
        else OWN_TEXT.lower()
        .replace('uint8 front_left', 'uint8 FRONT_LEFT')
        .replace('std_msgs/header', 'std_msgs/Header')
    )
    store.register(get_types_from_msg(text, OWN))
    if 'tf2_msgs/msg/TFMessage' not in store.fielddefs:
        store.register(
            get_types_from_msg(
                'geometry_msgs/TransformStamped[] transforms', 'tf2_msgs/msg/TFMessage'
            )
        )
    return store


ROS1, ROS2 = store_of(Stores.ROS1_NOETIC), store_of(Stores.ROS2_JAZZY)


def messages_of(store):
    """By topic three messages of random values."""
    rng = np.random.default_rng(7)
    return [
        (topic, START_NS + 10**8 * index + number, random_message(store, msgtype, rng))
        for index in range(3)
        for number, (topic, (msgtype, _)) in enumerate(TOPICS.items())
    ]


def write_ros1(path):
    with Ros1Writer(path) as writer:
        ids = {
            topic: writer.add_connection(topic, msgtype, typestore=ROS1, latching=int(latched))
            for topic, (msgtype, latched) in TOPICS.items()
        }
        for topic, stamp_ns, message in messages_of(ROS1):
            writer.write(ids[topic], stamp_ns, ROS1.serialize_ros1(message, TOPICS[topic][0]))
    return path


def write_ros1_in_mcap(path):
    with Ros1Reader(write_ros1(path.with_suffix('.bag'))) as reader, path.open('wb') as file:
        writer = McapWriter(file)
        writer.start(profile='ros1')
        ids = {}
        for each in reader.connections:
            name = each.msgtype.replace('/msg/', '/')
            schema = writer.register_schema(name, 'ros1msg', each.msgdef.data.encode())
            latching = {'latching': str(each.ext.latching)}
            ids[each.id] = writer.register_channel(each.topic, 'ros1', schema, latching)
        for each, stamp_ns, data in reader.messages():
            writer.add_message(ids[each.id], stamp_ns, data, stamp_ns)
        writer.finish()
    return path


def write_ros2(path, plugin):
    def profile(latched):
        return Qos(
            QosHistory.KEEP_LAST,
            7,
            QosReliability.BEST_EFFORT if not latched else QosReliability.RELIABLE,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            QosTime(1, 5),
            QosTime(2147483647, 4294967295),
            QosLiveliness.AUTOMATIC,
            QosTime(2147483647, 4294967295),
            avoid_ros_namespace_conventions=False,
        )

    with Ros2Writer(path, version=9, storage_plugin=plugin) as writer:
        ids = {
            topic: writer.add_connection(
                topic, msgtype, typestore=ROS2, offered_qos_profiles=[profile(latched)]
            )
            for topic, (msgtype, latched) in TOPICS.items()
        }
        for topic, stamp_ns, message in messages_of(ROS2):
            writer.write(ids[topic], stamp_ns, ROS2.serialize_cdr(message, TOPICS[topic][0]))
    return path


SOURCES = {
    'ros1': lambda folder: write_ros1(folder / 'bag.bag'),
    'ros1 in mcap': lambda folder: write_ros1_in_mcap(folder / 'bag.mcap'),
    'mcap': lambda folder: write_ros2(folder / 'bag', StoragePlugin.MCAP),
    'sqlite3': lambda folder: write_ros2(folder / 'bag', StoragePlugin.SQLITE3),
}


def values_of(message):
    """The values of a message by the names of its fields in lower case, without ROS 1's seq."""
    if is_dataclass(message):
        return tuple(
            (field.name.lower(), values_of(getattr(message, field.name)))
            for field in fields(message)
            if field.name not in NOT_IN_BOTH and not isinstance(field.default, int)
        )
    if isinstance(message, np.ndarray):
        return message.dtype.str, message.tobytes()
    return tuple(map(values_of, message)) if isinstance(message, list) else repr(message)


NOT_IN_BOTH = {'__msgtype__', 'seq', 'texture_resource', 'texture', 'uv_coordinates', 'mesh_file'}


def decoded(path):
    with AnyReader([path], default_typestore=ROS2) as reader:
        types = {each.topic: each.msgtype for each in reader.connections}
        return types, Counter(
            (each.topic, stamp_ns, values_of(reader.deserialize(data, each.msgtype)))
            for each, stamp_ns, data in reader.messages()
        )


@pytest.fixture(scope='module', params=SOURCES)
def source(request, tmp_path_factory):
    return SOURCES[request.param](tmp_path_factory.mktemp('source')), request.param


def convert(source, out, *words):
    return main(['to-bag', str(source), str(out), '-q', *words])


@pytest.mark.parametrize('target', OUTS)
def test_values_times_types_and_latching_are_kept(source, target, tmp_path, capsys):
    path, kind = source
    out = tmp_path / OUTS[target]
    code = convert(path, out, *STORAGE.get(target, ()))
    if kind == 'ros1 in mcap':
        path = path.with_suffix('.bag')
    types, messages = decoded(path)
    types_made, messages_made = decoded(out)
    assert types_made == types
    assert messages_made == messages
    with open_messages(out) as made:
        assert {*made.latched} == {topic for topic, (_, latched) in TOPICS.items() if latched}
    said = capsys.readouterr().err
    to_ros1 = target == 'ros1' and not kind.startswith('ros1')
    assert ('visualization_msgs/msg/Marker.texture' in said) == to_ros1
    assert code == int(to_ros1)


@pytest.mark.parametrize('target', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_a_bag_of_ros_2_keeps_its_bytes_and_its_qos(kind, target, tmp_path):
    path, out = SOURCES[kind](tmp_path), tmp_path / 'out'
    assert convert(path, out, *STORAGE.get(target, ())) == 0
    with AnyReader([path]) as before, AnyReader([out]) as after:
        rows = [
            [(each.topic, ns, bytes(data)) for each, ns, data in reader.messages()]
            for reader in (before, after)
        ]
        assert rows[0] == rows[1]
        profiles, kept = (
            {each.topic: each.ext.offered_qos_profiles for each in reader.connections}
            for reader in (before, after)
        )
        assert profiles == kept
        hashes, kept = (
            {each.topic: each.digest for each in reader.connections} for reader in (before, after)
        )
        assert hashes == kept
    metadata = yaml.safe_load((out / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert metadata['version'] == 8
    for topic in metadata['topics_with_message_count']:
        (profile,) = yaml.safe_load(topic['topic_metadata']['offered_qos_profiles'])
        assert all(isinstance(profile[name], int) for name in ('history', 'reliability'))


@pytest.mark.parametrize('kind', SOURCES)
def test_the_messages_are_read_by_mcap_ros2_support(kind, tmp_path):
    reader = pytest.importorskip('mcap_ros2.reader')
    out = tmp_path / 'out.mcap'
    assert convert(SOURCES[kind](tmp_path), out) == 0
    counts = Counter(message.channel.topic for message in reader.read_ros2_messages(str(out)))
    assert counts == dict.fromkeys(TOPICS, 3)
    with out.open('rb') as stream:
        schemas = make_reader(stream).get_summary().schemas.values()
    texts = {schema.name: schema.data.decode() for schema in schemas}
    assert {*texts} == {msgtype for msgtype, _ in TOPICS.values()}
    assert 'float64[4] speeds' in texts[OWN]
    assert 'float64[9] k' in texts['sensor_msgs/msg/CameraInfo']
    assert all('seq' not in text.split('MSG: std_msgs/Header')[-1] for text in texts.values())


def write_one(path, msgtype, text, data, **channel):
    """A ROS 1 bag with one message of a type that the text defines."""
    with Ros1Writer(path) as writer:
        made = writer.add_connection('/topic', msgtype, msgdef=text, md5sum='0' * 32, **channel)
        writer.write(made, START_NS, data)
    return path


@pytest.mark.parametrize(
    ('msgtype', 'text', 'size', 'made'),
    [
        ('tf/msg/tfMessage', 'uint32[] transforms', 4, 'tf2_msgs/msg/TFMessage'),
        ('std_msgs/msg/Time', 'time data', 8, 'builtin_interfaces/msg/Time'),
        ('std_msgs/msg/Duration', 'duration data', 8, 'builtin_interfaces/msg/Duration'),
        ('std_msgs/msg/String', 'string data', 4, 'std_msgs/msg/String'),
        ('robot_msgs/msg/Temperature', 'float32 celsius', 4, 'robot_msgs/msg/Temperature'),
        ('std_msgs/msg/Empty', '', 0, 'std_msgs/msg/Empty'),
        (
            'robot_msgs/msg/State',
            'int8 idle=-1\nstring A="x" y\nint16 v',
            2,
            'robot_msgs/msg/State',
        ),
    ],
)
def test_types_have_their_names_in_ros_2(msgtype, text, size, made, tmp_path):
    bag = write_one(tmp_path / 'bag.bag', msgtype, text, bytes(size))
    assert convert(bag, tmp_path / 'out.mcap') == 0
    with AnyReader([tmp_path / 'out.mcap']) as reader:
        ((connection, _, data),) = reader.messages()
        assert connection.msgtype == made
        assert reader.deserialize(data, made)
    assert convert(tmp_path / 'out.mcap', tmp_path / 'back.bag') == 0
    with Ros1Reader(tmp_path / 'back.bag') as back:
        renamed = msgtype if msgtype.startswith('std_msgs/') else made
        assert [each.msgtype for each in back.connections] == [renamed]
        assert [bytes(data) for _, _, data in back.messages()] == [bytes(size)]


def test_a_value_without_a_field_in_ros_2_is_named(tmp_path, capsys):
    text = 'float32 range\nfloat32 max_range\nfloat32 colour'
    values = np.array([1, 2, 3], '<f4').tobytes()
    bag = write_one(tmp_path / 'bag.bag', 'sensor_msgs/msg/Range', text, values)
    assert convert(bag, tmp_path / 'out.mcap') == 1
    said = capsys.readouterr().err
    assert 'sensor_msgs/msg/Range.colour; its values are left out of 1 message' in said
    with AnyReader([tmp_path / 'out.mcap']) as reader:
        (row,) = reader.messages()
        message = reader.deserialize(row[2], row[0].msgtype)
    assert (message.range, message.max_range, message.min_range) == (1, 2, 0)


def test_a_log_has_the_stamp_and_the_level_of_ros_2(tmp_path, capsys):
    log = ROS1.types['rosgraph_msgs/msg/Log'](
        ROS1.types['std_msgs/msg/Header'](3, ROS1.types['builtin_interfaces/msg/Time'](7, 8), ''),
        *(4, '/node', 'hot', 'a.cpp', 'main', 12, ['/rosout']),
    )
    with Ros1Writer(tmp_path / 'bag.bag') as writer:
        made = writer.add_connection('/rosout', 'rosgraph_msgs/msg/Log', typestore=ROS1)
        writer.write(made, START_NS, ROS1.serialize_ros1(log, 'rosgraph_msgs/msg/Log'))
    assert convert(tmp_path / 'bag.bag', tmp_path / 'out') == 1
    assert 'no field rosgraph_msgs/msg/Log.topics' in capsys.readouterr().err
    with AnyReader([tmp_path / 'out']) as reader:
        ((connection, _, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert connection.msgtype == 'rcl_interfaces/msg/Log'
    assert (message.stamp.sec, message.stamp.nanosec, message.level) == (7, 8, 30)
    assert (message.name, message.msg, message.file, message.line) == ('/node', 'hot', 'a.cpp', 12)
    assert convert(tmp_path / 'out', tmp_path / 'back.bag') == 0
    with AnyReader([tmp_path / 'back.bag']) as reader:
        ((connection, _, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert connection.msgtype == 'rosgraph_msgs/msg/Log'
    assert (message.header.stamp.sec, message.level, message.topics) == (7, 4, [])


IDL = '=' * 80 + '\nIDL: a_msgs/msg/W\nmodule a_msgs {{ module msg {{ struct W {{ {} }}; }}; }};\n'


@pytest.mark.parametrize(
    ('encoding', 'text', 'expected'),
    [
        ('ros2msg', '# comment\nint32 x 7\nwstring<=5 s\n', '# comment\nint32 x 7\nwstring<=5 s\n'),
        ('ros2idl', IDL.format('long x; wstring<5> s;'), 'int32 x\nwstring<=5 s\n'),
        ('ros2idl', IDL.format('long x; wstring s;'), 'int32 x\nwstring s\n'),
        ('', '', ''),
    ],
)
def test_a_definition_is_kept_or_becomes_the_text_of_a_message(encoding, text, expected, tmp_path):
    bag, data = tmp_path / 'bag.mcap', b'\0\1\0\0' + bytes(8)
    with bag.open('wb') as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema('a_msgs/msg/W', encoding, text.encode())
        channel = writer.register_channel('/topic', 'cdr', schema)
        writer.add_message(channel, START_NS, data, START_NS)
        writer.finish()
    assert convert(bag, tmp_path / 'out.mcap') == 0
    with (tmp_path / 'out.mcap').open('rb') as file:
        ((schema, _, message),) = make_reader(file).iter_messages()
    assert (schema.encoding, schema.data.decode(), message.data) == ('ros2msg', expected, data)


def test_an_undefined_type_cannot_become_ros_1(tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    with bag.open('wb') as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema('a_msgs/msg/W', '', b'')
        channel = writer.register_channel('/topic', 'cdr', schema)
        writer.add_message(channel, START_NS, bytes(8), START_NS)
        writer.finish()
    assert convert(bag, tmp_path / 'out.bag') == 2
    assert 'neither the bag nor ROS 2 Jazzy defines it' in capsys.readouterr().err
    assert not (tmp_path / 'out.bag').exists()


def test_an_attachment_is_named(tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    with bag.open('wb') as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/topic', 'cdr', schema)
        writer.add_message(channel, START_NS, b'\0\1\0\0\1\0\0\0\0', START_NS)
        writer.add_attachment(START_NS, START_NS, 'notes.txt', 'text/plain', b'rain')
        writer.finish()
    assert convert(bag, tmp_path / 'out') == 1
    assert '1 attachment of MCAP cannot be copied' in capsys.readouterr().err


def test_a_part_begins_with_what_was_latched_before(source, tmp_path):
    path, _ = source
    words = '--start', '0.15s', '--end', '0.25s', '--topics', '/imu', '/tf_static'
    assert convert(path, tmp_path / 'out.mcap', *words) == 0
    with open_messages(tmp_path / 'out.mcap') as messages:
        rows = [(message.topic, message.stamp_ns - START_NS) for message in messages]
    assert rows == [
        ('/tf_static', 150_000_000),
        ('/tf_static', 150_000_000),
        ('/imu', 200_000_001),
        ('/tf_static', 200_000_003),
    ]


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--for', 'kiss-icp'], '--for is for KITTI folders'),
        (['--images', 'raw'], '--images is for KITTI folders'),
        (['--ring-time'], '--ring-time is for KITTI folders'),
        (['--jobs', '2'], '--jobs is for KITTI folders'),
        (['--start', '3'], 'is a frame of a KITTI folder'),
        (['--start', '100s'], 'takes no message'),
        (['--streams', 'scan'], '--streams is for KITTI folders'),
        (['--topics', '/imo'], 'did you mean /imu'),
        (['--compression', 'bz2'], 'bz2'),
    ],
)
def test_options_that_have_no_meaning_are_refused(words, said, tmp_path, capsys):
    bag = write_ros1(tmp_path / 'bag.bag')
    assert convert(bag, tmp_path / 'out.mcap', *words) == 2
    text = capsys.readouterr().err
    assert said in text
    assert text.count('\n') == 1
    assert [*tmp_path.iterdir()] == [bag]


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--topics', '/x'], 'no topic is called /x; there are no topics'),
        (['--start', '1s'], 'the selection from 1s takes no message; the bag has none'),
    ],
)
def test_selections_of_a_bag_without_messages_are_refused(words, said, tmp_path, capsys):
    with Ros1Writer(tmp_path / 'empty.bag'):
        pass
    assert convert(tmp_path / 'empty.bag', tmp_path / 'out.mcap', *words) == 2
    assert capsys.readouterr().err.strip().endswith(said)


def test_the_bag_itself_and_an_existing_one_are_not_overwritten(tmp_path):
    bag = write_ros1(tmp_path / 'bag.bag')
    assert convert(bag, bag, '--overwrite') == 2
    assert convert(bag, tmp_path / 'out.mcap') == 0
    assert convert(bag, tmp_path / 'out.mcap') == 2
    assert convert(bag, tmp_path / 'out.mcap', '--overwrite') == 0


def test_a_truncated_bag_is_converted_as_far_as_it_goes(tmp_path, capsys):
    bag = write_ros1(tmp_path / 'bag.bag')
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) // 2])
    assert convert(bag, tmp_path / 'strict.mcap', '--strict') == 2
    assert not (tmp_path / 'strict.mcap').exists()
    capsys.readouterr()
    assert convert(bag, tmp_path / 'out.mcap') == 1
    assert 'bag.bag' in capsys.readouterr().err
    with open_messages(tmp_path / 'out.mcap') as messages:
        assert sum(1 for _ in messages) > 0
        assert messages.complete


def test_recover_does_the_same_with_ros_1_in_mcap(tmp_path):
    bag = write_ros1_in_mcap(tmp_path / 'bag.mcap')
    assert main(['recover', str(bag), str(tmp_path / 'out.mcap'), '-q']) == 0
    assert main(['recover', str(bag), str(tmp_path / 'out.bag'), '-q']) == 0
    expected = decoded(tmp_path / 'bag.bag')
    assert decoded(tmp_path / 'out.mcap') == expected
    assert decoded(tmp_path / 'out.bag') == expected
    with Ros1Reader(tmp_path / 'bag.bag') as before, Ros1Reader(tmp_path / 'out.bag') as after:
        assert [bytes(row[2]) for row in after.messages()] == [
            bytes(row[2]) for row in before.messages()
        ]
        assert {each.topic: each.digest for each in after.connections} == {
            each.topic: each.digest for each in before.connections
        }
