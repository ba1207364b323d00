# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Several bags read at once, and what their types are."""

from __future__ import annotations

import sqlite3

import pytest
from bag_samples import make_samples, write_bag
from mcap.writer import Writer

from kitti_ros2.bags.reader import bag_stamps, open_messages, summarize_bag
from kitti_ros2.model.errors import BadBagError, Loss
from kitti_ros2.options.outputs import BagOptions

POINT = 'geometry_msgs/msg/Point'
FOREIGN = 'my_msgs/msg/Wheel'


def write_mcap(path, rows, schemas):
    """Rows are (topic, type, stamp, data); schemas the text by type, None for none."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        channels = {}
        for topic, msgtype, stamp, data in rows:
            if topic not in channels:
                text = schemas.get(msgtype) or ''
                encoding = 'ros2msg' if text else ''
                schema = writer.register_schema(msgtype, encoding, text.encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()
    return path


def text(value):
    data = value.encode() + b'\0'
    return b'\0\1\0\0' + len(data).to_bytes(4, 'little') + data


STRING = {'std_msgs/msg/String': 'string data\n'}


def write_strings(path, topic, stamps):
    rows = [(topic, 'std_msgs/msg/String', stamp, text(f'{path.name} {stamp}')) for stamp in stamps]
    return write_mcap(path, rows, STRING)


def test_bags_are_merged_by_time(tmp_path):
    first = write_strings(tmp_path / 'a.mcap', '/a', [1, 4, 4, 9])
    second = write_strings(tmp_path / 'b.mcap', '/b', [2, 4, 8])
    third = write_strings(tmp_path / 'c.mcap', '/a', [3, 10])
    with open_messages([first, second, third]) as messages:
        found = [(each.stamp_ns, each.topic) for each in messages]
        assert messages.channels == (('/a', 'std_msgs/msg/String'), ('/b', 'std_msgs/msg/String'))
        assert messages.complete
        later = [each.stamp_ns for each in messages.since(4)]
    assert found == [
        (1, '/a'),
        (2, '/b'),
        (3, '/a'),
        (4, '/a'),
        (4, '/a'),
        (4, '/b'),
        (8, '/b'),
        (9, '/a'),
        (10, '/a'),
    ]
    assert later == [4, 4, 4, 8, 9, 10]
    stamps = bag_stamps([first, second, third])
    assert {topic: each.tolist() for topic, each in stamps.items()} == {
        '/a': [1, 3, 4, 4, 9, 10],
        '/b': [2, 4, 8],
    }
    summary = summarize_bag([first, second, third])
    assert (summary.container, summary.message_count, len(summary.files)) == ('mcap', 9, 3)


def test_bags_of_all_containers_go_together(tmp_path):
    samples = make_samples(rounds=6)
    parts = {
        'a.mcap': BagOptions(),
        'b.bag': BagOptions(storage='ros1'),
        'c': BagOptions(storage='sqlite3'),
    }
    paths = [
        write_bag(tmp_path / name, options, samples[number::3])
        for number, (name, options) in enumerate(parts.items())
    ]
    with open_messages(paths) as messages:
        found = [(each.stamp_ns, each.topic) for each in messages]
        for message in messages:
            messages.typestore.deserialize_cdr(message.data, message.msgtype)
        assert '/tf_static' in messages.latched
        losses = messages.losses
    # ROS 1's marker lacks fields.
    markers = {each.stamp_ns for each in samples[1::3] if 'marker' in each.channel.topic}
    assert sum(losses.values()) == len(markers) > 0
    assert all('visualization_msgs/msg/Marker ' in text for text in losses)
    assert found == [
        (each.stamp_ns, each.channel.topic) for each in samples if each.stamp_ns not in markers
    ]


def test_damage_of_one_bag_is_told_of_all(tmp_path):
    sound = write_strings(tmp_path / 'a.mcap', '/a', range(10))
    bad = write_strings(tmp_path / 'b.mcap', '/b', range(10))
    bad.write_bytes(bad.read_bytes()[:-100])
    with open_messages([sound, bad]) as messages:
        assert {each.topic for each in messages} == {'/a', '/b'}
        assert not messages.complete
        assert str(bad) in messages.problems[0]


def test_a_topic_of_two_types_is_an_error_that_names_both(tmp_path):
    first = write_strings(tmp_path / 'a.mcap', '/a', [1])
    second = write_mcap(
        tmp_path / 'b.mcap',
        [('/a', POINT, 1, bytes(28))],
        {POINT: 'float64 x\nfloat64 y\nfloat64 z'},
    )
    with pytest.raises(BadBagError) as caught:
        open_messages([first, second])
    for part in ('/a', POINT, 'std_msgs/msg/String', str(first), str(second)):
        assert part in str(caught.value)
    with open_messages([first, second], ['/b']) as messages:
        assert messages.channels == ()


def test_a_topic_of_two_types_in_one_bag_is_read_as_the_first(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        for number, (msgtype, definition) in enumerate([*STRING.items(), (POINT, 'float64 x')]):
            schema = writer.register_schema(msgtype, 'ros2msg', definition.encode())
            channel = writer.register_channel('/a', 'cdr', schema)
            writer.add_message(channel, number, text('1'), number)
        writer.finish()
    with open_messages(path) as messages:
        assert [each.stamp_ns for each in messages] == [0]
        assert messages.channels == (('/a', 'std_msgs/msg/String'),)
        (warning,) = messages.problems
        assert not messages.complete
    assert POINT in warning
    assert 'std_msgs/msg/String' in warning


@pytest.mark.parametrize('nested', [False, True])
def test_a_type_that_bags_define_otherwise_is_read_of_the_first(nested, tmp_path):
    hub = f'my_msgs/Hub hub\n{"=" * 80}\nMSG: my_msgs/Hub\n' if nested else ''
    paths = [
        write_mcap(
            tmp_path / f'{name}.mcap',
            [(f'/{name}', FOREIGN, 1, bytes(12)), ('/both', 'std_msgs/msg/String', 2, text('x'))],
            {FOREIGN: f'{hub}{kind} size\n', **STRING},
        )
        for name, kind in (('a', 'int32'), ('b', 'float64'))
    ]
    with open_messages(paths) as messages:
        assert [each.topic for each in messages] == ['/a', '/both', '/both']
        (warning,) = messages.problems
        assert messages.losses == {warning: 1}
        assert not messages.complete
    for part in (*map(str, paths), '/b', 'my_msgs/msg/Hub' if nested else FOREIGN):
        assert part in warning
    with pytest.raises(BadBagError, match='defined otherwise'):
        open_messages(paths, ['/a', '/b'])
    for path in paths:
        with open_messages(path) as messages:
            assert len(list(messages)) == 2


def test_two_definitions_in_one_bag_are_told(tmp_path):
    line = '=' * 80
    hub = f'my_msgs/Hub hub\n{line}\nMSG: my_msgs/Hub\n'
    schemas = {FOREIGN: f'{hub}int32 size\n', 'my_msgs/msg/Axle': f'{hub}float64 size\n'}
    rows = [('/a', FOREIGN, 1, bytes(8)), ('/b', 'my_msgs/msg/Axle', 2, bytes(12))]
    with open_messages(write_mcap(tmp_path / 'a.mcap', rows, schemas)) as messages:
        (warning,) = messages.problems
        assert 'my_msgs/msg/Hub' in warning
        assert messages.complete
        assert len(list(messages)) == 2


def test_types_that_nobody_defines_are_told_and_left_out(tmp_path):
    rows = [
        ('/a', 'std_msgs/msg/String', 1, text('a')),
        ('/b', FOREIGN, 2, bytes(8)),
        ('/b', FOREIGN, 3, bytes(8)),
        ('/c', 'sensor_msgs/msg/JointState', 4, bytes(8)),
    ]
    path = write_mcap(tmp_path / 'a.mcap', rows, STRING)
    with open_messages(path) as messages:
        assert [each.topic for each in messages] == ['/a', '/c']
        (warning,) = messages.problems
        ((channel, loss),) = messages.left_out
        assert (channel.topic, channel.msgtype) == ('/b', FOREIGN)
        assert loss == Loss('/b', 2, warning)
        assert messages.complete
    assert '/b' in warning
    assert FOREIGN in warning
    with pytest.raises(BadBagError, match=FOREIGN):
        open_messages(path, ['/b'])
    with open_messages(path, ['/a']) as messages:
        assert messages.problems == ()


def test_a_definition_that_cannot_be_read_is_told_and_jazzys_is_used(tmp_path):
    rows = [('/a', 'std_msgs/msg/String', 1, text('a'))]
    path = write_mcap(tmp_path / 'a.mcap', rows, {'std_msgs/msg/String': 'string ?? data ;;'})
    with open_messages(path) as messages:
        (warning,) = messages.problems
        (message,) = messages
        decoded = messages.typestore.deserialize_cdr(message.data, message.msgtype)
    assert decoded.data == 'a'
    assert 'std_msgs/msg/String' in warning


def test_databases_of_earlier_versions_have_jazzys_types(tmp_path):
    """Humble's and Foxy's have no definitions in them."""
    for version, qos in enumerate(('', ', offered_qos_profiles TEXT')):
        path = tmp_path / f'{version}.db3'
        with sqlite3.connect(path) as connection:
            connection.executescript(
                'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT,'
                f' serialization_format TEXT{qos});'
                'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER,'
                ' timestamp INTEGER, data BLOB);'
            )
            row = [1, '/a', 'std_msgs/msg/String', 'cdr']
            row += ['- history: 1\n  depth: 7\n  durability: 1\n'] if qos else []
            connection.execute(f'INSERT INTO topics VALUES({", ".join("?" * len(row))})', row)
            connection.execute('INSERT INTO messages VALUES(1, 1, 5, ?)', [text('old')])
        connection.close()
        with open_messages(path) as messages:
            (message,) = messages
            decoded = messages.typestore.deserialize_cdr(message.data, message.msgtype)
            assert decoded.data == 'old'
            assert messages.latched == ({'/a': 7} if qos else {})
            assert messages.problems == ()


def test_other_encodings_are_told(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        for topic, encoding in (('/a', 'cdr'), ('/b', 'json')):
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 1, text('a'), 1)
        writer.finish()
    with open_messages(path) as messages:
        assert [each.topic for each in messages] == ['/a']
        (warning,) = messages.problems
        assert messages.complete
    assert '/b is json' in warning
