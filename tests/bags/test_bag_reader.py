# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of others, bags that were cut off, and things that are no bags."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tarfile
from collections import Counter

import pytest
import yaml
import zstandard
from bag_samples import CHANNELS, START_NS, jazzy, make_samples, write_bag
from mcap.writer import CompressionType, IndexType, Writer

from kitti_ros2.bags.decompression import decompress_file
from kitti_ros2.bags.reader import bag_stamps, open_messages, summarize_bag
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import BadBagError
from kitti_ros2.options.outputs import BagOptions


@pytest.fixture(scope='module')
def samples():
    return make_samples(rounds=3, cloud_bytes=3_000_000)


def read(path):
    with open_messages(path) as messages:
        return [(each.topic, each.stamp_ns, bytes(each.data)) for each in messages]


def triples(samples):
    return [(each.channel.topic, each.stamp_ns, each.data) for each in samples]


@pytest.mark.parametrize(
    ('name', 'container', 'topics', 'messages', 'compression'),
    [
        ('example-lz4.bag', 'ros1', 9, 8647, 'lz4'),
        ('tilt_laser.bag', 'ros1', 9, 4093, 'none'),
        ('no-messages.bag', 'ros1', 0, 0, 'none'),
        ('nav2_turtlebot.mcap', 'mcap', 4, 8197, 'zstd'),
        ('rosbag2_empty_sqlite3', 'rosbag2 sqlite3', 2, 0, 'none'),
        ('rosbag2_talker_sqlite3', 'rosbag2 sqlite3', 3, 20, 'none'),
        ('rosbag2_talker_sqlite3/talker.db3', 'sqlite3', 3, 20, 'none'),
        ('rosbag2_talker_mcap', 'rosbag2 mcap', 3, 20, 'zstd'),
        ('rosbag2_split_mcap', 'rosbag2 mcap', 8, 6074, 'zstd'),
    ],
)
def test_real_bags(real_bags, name, container, topics, messages, compression):
    summary = summarize_bag(real_bags / name)
    assert summary.complete
    assert summary.problems == ()
    assert (summary.container, summary.compression) == (container, compression)
    assert (len(summary.topics), summary.message_count) == (topics, messages)
    found = read(real_bags / name)
    assert len(found) == messages
    assert [each[1] for each in found] == sorted(each[1] for each in found)
    if messages:
        assert (found[0][1], found[-1][1]) == (summary.start_ns, summary.end_ns)


@pytest.mark.parametrize(
    'name', ['tilt_laser.bag', 'example-lz4.bag', 'nav2_turtlebot.mcap', 'rosbag2_talker_mcap']
)
def test_real_messages_can_be_decoded(real_bags, name):
    """ROS 1 messages as well, which come as CDR."""
    with open_messages(real_bags / name) as messages:
        kinds = set()
        for message in messages:
            decoded = messages.typestore.deserialize_cdr(message.data, message.msgtype)
            kinds.add(decoded.__msgtype__)
            if message.topic == '/imu_data':
                assert abs(decoded.header.stamp.sec * 10**9 - message.stamp_ns) < 10**10
    assert kinds == {each.msgtype for each in summarize_bag(real_bags / name).topics if each.count}


def test_real_point_clouds(real_bags, tmp_path):
    with tarfile.open(real_bags / 'realsense_pointcloud2_mcap.tar.xz') as archive:
        names = archive.getnames()
        # Python 3.11.2, of Debian 12, has no filters.
        archive.extractall(
            tmp_path, **({'filter': 'data'} if hasattr(tarfile, 'data_filter') else {})
        )
    (metadata,) = [tmp_path / name for name in names if name.endswith('metadata.yaml')]
    summary = summarize_bag(metadata.parent)
    assert summary.complete
    with open_messages(metadata.parent) as messages:
        clouds = 0
        for message in messages:
            if message.msgtype == 'sensor_msgs/msg/PointCloud2':
                cloud = messages.typestore.deserialize_cdr(message.data, message.msgtype)
                assert cloud.point_step == 16
                clouds += 1
    assert clouds == sum(
        each.count for each in summary.topics if each.msgtype == 'sensor_msgs/msg/PointCloud2'
    )
    assert clouds


def test_rates_and_gaps(tmp_path):
    stamps = [0, 100, 200, 300, 700, 800]
    with open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy()) as bag:
        channel = bag.add_channel(Channel('/a', 'std_msgs/msg/String'))
        bag.add_channel(Channel('/empty', 'std_msgs/msg/String'))
        for stamp_ms in stamps:
            bag.write(channel, START_NS + stamp_ms * 10**6, [b'x'])
    topic, empty = summarize_bag(bag.path).topics
    assert (topic.count, topic.start_ns, topic.end_ns) == (6, START_NS, START_NS + 8 * 10**8)
    assert topic.median_period_ns == 10**8
    assert (topic.largest_gap_ns, topic.largest_gap_at_ns) == (4 * 10**8, START_NS + 3 * 10**8)
    assert topic.mean_rate_hz == 5 / 0.8
    assert (empty.count, empty.start_ns, empty.mean_rate_hz) == (0, None, None)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
@pytest.mark.parametrize('count', [0, 1, 7])
def test_each_topic_has_the_stamps_of_its_messages(storage, count, tmp_path):
    """Topics in another order than their messages, and two without any."""
    suffix = {'mcap': '.mcap', 'sqlite3': '', 'ros1': '.bag'}[storage]
    with open_bag(tmp_path / f'bag{suffix}', BagOptions(storage=storage), jazzy()) as bag:
        names = ('/z', '/none', '/a', '/m', '/y')
        ids = [bag.add_channel(Channel(name, 'std_msgs/msg/String')) for name in names]
        expected = {name: [] for name in names}
        for number in range(count):
            for place in (4, 0, 2)[: 1 + number % 3]:
                stamp_ns = START_NS + number * 1000 + place
                bag.write(ids[place], stamp_ns, [b'\0\1\0\0\1\0\0\0\0\0\0\0'])
                expected[names[place]].append(stamp_ns)
    found = {name: stamps.tolist() for name, stamps in bag_stamps(bag.path).items()}
    assert {name: stamps for name, stamps in found.items() if stamps} == {
        name: stamps for name, stamps in expected.items() if stamps
    }
    assert {each.name: each.count for each in summarize_bag(bag.path).topics} == {
        name: len(stamps) for name, stamps in expected.items()
    }


@pytest.mark.one_in(3)
@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
@pytest.mark.parametrize('part', [0.999, 0.7, 0.4, 0.01])
def test_cut_mcap_is_read_as_far_as_it_goes(compression, part, samples, tmp_path):
    path = write_bag(tmp_path / 'bag.mcap', BagOptions(compression=compression), samples)
    with path.open('r+b') as file:
        file.truncate(int(path.stat().st_size * part))
    summary = summarize_bag(path)
    assert not summary.complete
    assert len(summary.problems) == 1
    assert str(path) in summary.problems[0]
    with open_messages(path) as messages:
        found = [(each.topic, each.stamp_ns, bytes(each.data)) for each in messages]
        assert not messages.complete
        for each in messages:
            messages.typestore.deserialize_cdr(each.data, each.msgtype)
    assert found == triples(samples)[: len(found)]
    assert summary.message_count == len(found)
    if part == 0.999:
        assert len(found) == len(samples)


def test_damaged_chunk_of_a_cut_file_is_passed_over(samples, tmp_path):
    path = write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    data = bytearray(path.read_bytes()[:-10])
    data[1_000_000] ^= 255
    path.write_bytes(data)
    summary = summarize_bag(path)
    assert not summary.complete
    assert 'wrong checksum' in summary.problems[0]
    found = read(path)
    assert 0 < len(found) == summary.message_count < len(samples)


def test_damage_in_a_finished_file_costs_the_messages_it_hits(samples, tmp_path):
    path = write_bag(tmp_path / 'bag.mcap', BagOptions(compression='zstd'), samples)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)
    with open_messages(path) as messages:
        found = [(each.topic, each.stamp_ns, bytes(each.data)) for each in messages]
        assert not messages.complete
        assert messages.losses
        assert any(str(path) in text and 'damaged' in text for text in messages.problems)
    assert 0 < len(found) < len(samples)
    assert not Counter(found) - Counter(triples(samples))


@pytest.mark.parametrize('chunked', [True, False])
@pytest.mark.parametrize('index', [IndexType.ALL, IndexType.NONE])
@pytest.mark.parametrize('profile', ['ros2', ''])
def test_mcap_of_other_writers(chunked, index, profile, tmp_path):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as file:
        writer = Writer(
            file,
            use_chunking=chunked,
            index_types=index,
            compression=CompressionType.LZ4,
            use_summary_offsets=False,
        )
        writer.start(profile=profile, library='another')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        channel = writer.register_channel('/text', 'cdr', schema)
        for number in range(10):
            writer.add_message(channel, number, b'\0\1\0\0\1\0\0\0\0', number)
        writer.finish()
    assert summarize_bag(path).message_count == 10
    assert [stamp_ns for _, stamp_ns, _ in read(path)] == list(range(10))


def test_mcap_without_cdr_says_so(tmp_path):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel('/text', 'json', 0)
        writer.add_message(channel, 1, b'{}', 1)
        writer.finish()
    assert summarize_bag(path).message_count == 1
    with pytest.raises(BadBagError, match='json'):
        open_messages(path)


def test_one_cut_file_of_a_split_bag(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(split_duration_ns=10**8), samples)
    last = max(path.glob('*.mcap'))
    last.write_bytes(last.read_bytes()[:-100])
    summary = summarize_bag(path)
    assert not summary.complete
    assert summary.message_count == len(samples)
    assert read(path) == triples(samples)


def test_file_compressed_directory(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples)
    (plain,) = path.glob('*.db3')
    packed = plain.with_name(f'{plain.name}.zstd')
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    plain.unlink()
    information = yaml.safe_load((path / 'metadata.yaml').read_text())
    inner = information['rosbag2_bagfile_information']
    inner |= {'compression_mode': 'FILE', 'compression_format': 'zstd'}
    inner['relative_file_paths'] = [packed.name]
    (path / 'metadata.yaml').write_text(yaml.safe_dump(information))
    summary = summarize_bag(path)
    assert (summary.message_count, summary.compression) == (len(samples), 'zstd')
    assert read(path) == triples(samples)


def test_metadata_that_miscounts_is_said(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(), samples)
    metadata = path / 'metadata.yaml'
    metadata.write_text(
        metadata.read_text().replace(f'message_count: {len(samples)}', 'message_count: 7')
    )
    (warning,) = summarize_bag(path).problems
    assert 'counts 7 messages' in warning


def make_bad(kind, path, samples):
    if kind == 'empty':
        path.touch()
    elif kind == 'text':
        path.write_text('no bag at all\n' * 9)
    elif kind == 'directory':
        path.mkdir()
    elif kind == 'unfinished directory':
        write_bag(path.with_suffix(''), BagOptions(), samples).rename(path)
        (path / 'metadata.yaml').unlink()
    elif kind == 'bad yaml':
        path.mkdir()
        (path / 'metadata.yaml').write_text('a: [')
    elif kind == 'other yaml':
        path.mkdir()
        (path / 'metadata.yaml').write_text('just text')
    elif kind == 'missing file':
        write_bag(path.with_suffix(''), BagOptions(), samples).rename(path)
        next(path.glob('*.mcap')).unlink()
    elif kind == 'other database':
        with sqlite3.connect(path) as connection:
            connection.execute('CREATE TABLE mine(id INTEGER)')
        connection.close()


BAD = {
    'absent': 'no such file',
    'empty': 'empty',
    'text': 'another kind',
    'directory': 'metadata.yaml',
    'bad yaml': 'no metadata',
    'other yaml': 'no metadata',
    'missing file': 'is missing, which its',
    'other database': 'sqlite3',
}


@pytest.mark.parametrize(('kind', 'complaint'), BAD.items(), ids=BAD)
def test_what_is_no_bag_is_one_line(kind, complaint, samples, tmp_path):
    ending = '.db3' if 'database' in kind else ''
    path = tmp_path / f'bad{ending or ".mcap"}'
    if kind != 'absent':
        make_bad(kind, path, samples[: 2 * len(CHANNELS)])
    with pytest.raises(BadBagError, match=complaint) as caught:
        summarize_bag(path)
    assert '\n' not in str(caught.value)
    assert str(path) in str(caught.value)
    with pytest.raises(BadBagError) as caught:
        read(path)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('part', [0.6, 0.95])
@pytest.mark.parametrize('storage', ['sqlite3', 'ros1'])
def test_what_was_cut_off_is_read_as_far_as_it_goes(storage, part, tmp_path):
    many = make_samples(rounds=60, cloud_bytes=20_000)
    path = write_bag(tmp_path / 'bag', BagOptions(storage=storage), many)
    whole = read(path)
    (file,) = path.glob('*.db3') if path.is_dir() else [path]
    with file.open('r+b') as opened:
        opened.truncate(int(file.stat().st_size * part))
    summary = summarize_bag(path)
    assert not summary.complete
    assert any(f'{file}: cut off at byte' in warning for warning in summary.problems)
    found = read(path)
    assert len(whole) / 4 < len(found) < len(whole)
    # The row at the cut still counts where only the rest of its data is gone.
    assert summary.message_count - len(found) in {0, 1}
    assert not Counter(found) - Counter(whole)


def test_a_directory_without_metadata_is_read_by_its_files(samples, tmp_path):
    path = tmp_path / 'bag'
    write_bag(path, BagOptions(), samples)
    (path / 'metadata.yaml').unlink()
    assert read(path) == triples(samples)
    assert any('metadata.yaml' in warning for warning in summarize_bag(path).problems)


@pytest.mark.parametrize('storages', [('ros1', 'mcap'), ('mcap', 'sqlite3')])
def test_a_directory_of_bags_in_two_containers_names_those_that_are_not_read(
    storages, samples, tmp_path
):
    names = {'ros1': 'a.bag', 'mcap': 'b.mcap', 'sqlite3': 'c.db3'}
    for storage in storages:
        path = write_bag(tmp_path / storage, BagOptions(storage=storage, split_size=10**9), samples)
        (file,) = (file for file in path.iterdir() if file.suffix != '.yaml')
        file.rename(tmp_path / names[storage])
        shutil.rmtree(path)
    summary = summarize_bag(tmp_path)
    read_as, other = storages
    text = f'{tmp_path}: holds {names[other]} too; only its {read_as} files are read'
    assert any(text in problem for problem in summary.problems)
    assert summary.complete
    assert read(tmp_path) == read(tmp_path / names[read_as])


def test_recorder_that_did_not_close_its_database(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples)
    (file,) = path.glob('*.db3')
    shutil.copy(file, f'{file}-wal')
    summary = summarize_bag(file)
    assert not summary.complete
    assert 'did not close' in summary.problems[0]


@pytest.mark.parametrize('name', ['a.mcap', 'a.bag', 'a.db3', 'metadata.yaml'])
def test_pipes_are_refused_and_not_waited_for(name, tmp_path):
    os.mkfifo(tmp_path / name)
    for path in (tmp_path, tmp_path / name):
        with pytest.raises(BadBagError, match=r'no regular file|without metadata'):
            open_messages(path)
        with pytest.raises(BadBagError, match=r'no regular file|without metadata'):
            summarize_bag(path)


@pytest.mark.parametrize('head', [b'\x89MCAP0\r\n', b'#ROSBAG V2.0\n', b'SQLite format 3\0'])
@pytest.mark.parametrize('size', [0, 1, 20, 40])
def test_a_head_alone_is_an_empty_bag_or_none(head, size, tmp_path):
    path = tmp_path / 'bag'
    path.write_bytes(head + bytes(size))
    if head.startswith(b'SQLite'):
        with pytest.raises(BadBagError, match=str(path)):
            open_messages(path)
        return
    with open_messages(path) as messages:
        assert list(messages) == []
        assert all(str(path) in text for text in messages.losses)
        assert messages.losses


@pytest.mark.parametrize(
    'text', ['[' * 50_000, 'a: &a [*a]', 'rosbag2_bagfile_information: {storage_identifier: [x]}']
)
def test_metadata_of_any_shape_is_no_reason_to_fail(text, samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(), samples[: len(CHANNELS)])
    (path / 'metadata.yaml').write_text(text)
    assert len(read(path)) == len(CHANNELS)
    assert 'no metadata of rosbag2' in summarize_bag(path).problems[0]


def test_a_database_whose_topics_have_no_names_is_damaged(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples[: len(CHANNELS)])
    (file,) = path.glob('*.db3')
    with sqlite3.connect(file) as connection:
        connection.execute("UPDATE topics SET name = x'ff00' WHERE id = 2")
    connection.close()
    assert len(read(path)) == len(CHANNELS) - 1
    assert not summarize_bag(path).complete


def test_a_compressed_file_is_unpacked_in_small_pieces(tmp_path):
    """A small file can unpack to more than there is memory."""
    packed = tmp_path / 'a.mcap.zstd'
    packed.write_bytes(zstandard.compress(b'\x89MCAP0\r\n' + bytes(100_000_000)))
    with packed.open('rb') as file:
        sizes = [len(block) for block in decompress_file(file)]
    assert sum(sizes) == 100_000_008
    assert max(sizes) < 1_000_000


@pytest.mark.parametrize('encoding', ['json', 'protobuf'])
def test_what_is_not_read_among_others_is_told(encoding, tmp_path):
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        text = writer.register_channel('/text', 'cdr', schema)
        other = writer.register_channel('/other', encoding, schema)
        writer.add_message(text, 1, b'\0\1\0\0\1\0\0\0\0', 1)
        writer.add_message(other, 2, b'{}', 2)
        writer.finish()
    with open_messages(path) as messages:
        assert [each.topic for each in messages] == ['/text']
        assert messages.problems == (f'{path}: /other is {encoding}, which is not read',)
        assert messages.complete


def mcap_bag(path, channels):
    """An MCAP file: topic, type, encoding of the schema, encoding of the messages, one each."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros2')
        for topic, msgtype, text, encoding in channels:
            schema = writer.register_schema(msgtype, text, b'string data\n')
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 1, b'\0\1\0\0\2\0\0\0a\0', 1)
        writer.finish()
    return path


def unnamed(path, encoding=''):
    """Write another encoding into the topics of a database."""
    with sqlite3.connect(path) as connection:
        connection.execute('UPDATE topics SET serialization_format = ?', [encoding])
    connection.close()


@pytest.mark.parametrize('name', ['', 'a.mcap'])
def test_a_bag_without_a_serialization_format_is_read_as_cdr(name, samples, tmp_path):
    if name:
        names = {'/a': 'std_msgs/msg/String', '/b': 'std_msgs/String'}
        channels = [(topic, msgtype, 'ros2msg', '') for topic, msgtype in names.items()]
        path = mcap_bag(tmp_path / name, [*channels, ('/c', names['/a'], 'ros2msg', 'cdr')])
        expected, few, file = ['/a', '/b', '/c'], '2 of its 3', path
    else:
        path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples)
        (file,) = path.glob('*.db3')
        unnamed(file)
        meta = path / 'metadata.yaml'
        meta.write_text(meta.read_text().replace('format: cdr', 'format: ""'))
        expected, few = [each.channel.topic for each in samples], f'{len(CHANNELS)} of its 14'
    with open_messages(path) as messages:
        assert [each.topic for each in messages] == expected
        note = f'{file}: {few} topics have an empty serialization_format; they are read as cdr'
        assert messages.problems == (note,)
        assert messages.complete
        assert {each.msgtype for each in messages.sources.values()} <= {
            each.msgtype for each in CHANNELS
        }
    index = summarize_bag(path)
    assert index.complete
    assert note in index.problems


def test_a_damaged_database_without_a_serialization_format_is_read(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples)
    (file,) = path.glob('*.db3')
    unnamed(file)
    with file.open('r+b') as database:
        database.truncate(file.stat().st_size - 4096)
    with open_messages(path) as messages:
        assert sum(1 for _ in messages) > len(samples) // 2
        assert any('they are read as cdr' in each for each in messages.problems)


@pytest.mark.parametrize(
    ('msgtype', 'text', 'encoding', 'said'),
    [
        ('std_msgs/msg/String', 'ros2msg', 'flatbuffer', 'has messages in flatbuffer; expected'),
        ('a.Text', 'protobuf', '', 'has messages in an encoding that is not named; expected'),
        ('std_msgs/String', 'ros1msg', '', 'has messages in an encoding that is not named;'),
        ('Text', 'jsonschema', '', 'has messages in an encoding that is not named; expected'),
    ],
)
def test_other_unknown_encodings_are_refused(msgtype, text, encoding, said, tmp_path):
    path = mcap_bag(tmp_path / 'a.mcap', [('/a', msgtype, text, encoding)])
    with pytest.raises(BadBagError, match=said):
        open_messages(path)


def test_another_encoding_of_a_database_is_refused(samples, tmp_path):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), samples)
    unnamed(*path.glob('*.db3'), encoding='proto')
    with pytest.raises(BadBagError, match='has messages in proto; expected messages in cdr'):
        open_messages(path)
