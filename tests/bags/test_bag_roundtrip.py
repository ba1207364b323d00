# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What goes into a bag comes out again: every container, compression and split, several readers."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
import yaml
from bag_samples import CHANNELS, START_NS, jazzy, make_samples, write_bag
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from kitti_ros2.bags.reader import open_messages, summarize_bag
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.model.bag_formats import ZSTD_MAGIC, Channel
from kitti_ros2.options.outputs import BagOptions

SECOND = 1_000_000_000
CASES = {
    'mcap file': ('bag.mcap', {}),
    'mcap file lz4': ('bag.mcap', {'compression': 'lz4'}),
    'mcap file zstd 1': ('bag.mcap', {'compression': 'zstd', 'compression_level': 1}),
    'mcap': ('bag', {}),
    'mcap zstd': ('bag', {'compression': 'zstd'}),
    'mcap by size': ('bag', {'split_size': 1_000_000}),
    'mcap zstd by duration': ('bag', {'compression': 'zstd', 'split_duration_ns': SECOND // 5}),
    'sqlite3': ('bag', {'storage': 'sqlite3'}),
    'sqlite3 zstd': ('bag', {'storage': 'sqlite3', 'compression': 'zstd'}),
    'sqlite3 by size': ('bag', {'storage': 'sqlite3', 'split_size': 1_000_000}),
    'sqlite3 zstd by duration': (
        'bag',
        {'storage': 'sqlite3', 'compression': 'zstd', 'split_duration_ns': SECOND // 5},
    ),
    'ros1': ('bag.bag', {'storage': 'ros1'}),
    'ros1 lz4': ('bag.bag', {'storage': 'ros1', 'compression': 'lz4'}),
    'ros1 bz2': ('bag.bag', {'storage': 'ros1', 'compression': 'bz2'}),
    'ros1 by size': ('bag', {'storage': 'ros1', 'split_size': 1_000_000}),
}
ROS1_MD5 = {
    'sensor_msgs/msg/CameraInfo': 'c9a58c1b0b154e0e6da7578cb991d214',
    'sensor_msgs/msg/Imu': '6a62c6daae103f4ff57a132d6f95cec2',
    'sensor_msgs/msg/PointCloud2': '1158d486dd51d683ce2f1be655c3c181',
    'sensor_msgs/msg/Image': '060021388200f6f0f447d0fcd9c64743',
    'sensor_msgs/msg/CompressedImage': '8f7a12909da2c9d3332d540a0977563f',
    'sensor_msgs/msg/NavSatFix': '2d3a8cd499b9b4a0249fb98fd05cfa48',
    'geometry_msgs/msg/TwistStamped': '98d34b0043a2093cf9d9345ab6eef12e',
    'nav_msgs/msg/Odometry': 'cd5e73d190d741a2f92e81eda573aca7',
    'nav_msgs/msg/Path': '6227e2b7e9cce15051f669a5e197bbf7',
    'tf2_msgs/msg/TFMessage': '94810edda583a504dfda3829e70d7eec',
    'visualization_msgs/msg/MarkerArray': 'd155b9ce5188fbaf89745847fd5882d7',
    'std_msgs/msg/String': '992ce8a1687cec8c8bd883ec73ca41d1',
}
SOURCE = {'recording': '2011_09_26_drive_0005', 'note': 'a: "b"\nü \x7f 😀', 'empty': ''}


@pytest.fixture(scope='module')
def samples():
    return make_samples(rounds=5, cloud_bytes=400_000)


@pytest.fixture(scope='module')
def bags(samples, tmp_path_factory):
    """Every case's bag, written when it is first asked for."""
    cache = {}

    def bag(case):
        if case not in cache:
            name, options = CASES[case]
            options = BagOptions(**options)
            path = tmp_path_factory.mktemp('bags') / name
            cache[case] = write_bag(path, options, samples, source_metadata=SOURCE), options
        return cache[case]

    return bag


@pytest.fixture(params=CASES)
def written(request, bags):
    return bags(request.param)


def cases(*words):
    """Run a test with the cases that have one of the words in their name."""
    names = [case for case in CASES if any(word in case for word in words)]
    return pytest.mark.parametrize('written', names, indirect=True)


def mcap_files(path):
    return [path] if path.is_file() else sorted(path.glob('*.mcap'))


def bag_files(path):
    return [path] if path.is_file() else sorted({*path.iterdir()} - {path / 'metadata.yaml'})


def assert_same(ours, theirs, *, ignored=()):
    """Two messages have equal fields, but for those that ROS 1 does not know."""
    if isinstance(ours, np.ndarray):
        np.testing.assert_array_equal(ours, theirs)
    elif isinstance(ours, list):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other, ignored=ignored)
    elif hasattr(ours, '__dataclass_fields__'):
        for name in ours.__dataclass_fields__:
            # Fields of ROS 2 are in small letters; the rest are constants.
            if name.islower() and name not in ignored and name != '__msgtype__':
                other = getattr(theirs, name, None)
                other = getattr(theirs, name.upper()) if other is None else other
                assert_same(getattr(ours, name), other, ignored=ignored)
    else:
        assert ours == theirs


@pytest.mark.one_in(3)
def test_messages_come_back_in_order(written, samples):
    path, options = written
    with open_messages(path) as messages:
        read = list(messages)
        assert messages.complete
        assert {topic for topic, _ in messages.channels} == {each.topic for each in CHANNELS}
    assert len(read) == len(samples)
    for message, sample in zip(read, samples, strict=True):
        expected = (sample.channel.topic, sample.channel.msgtype, sample.stamp_ns)
        assert message[:3] == expected
        if options.storage != 'ros1' or 'Marker' not in message.msgtype:
            assert bytes(message.data) == sample.data


def test_topics_can_be_chosen(written, samples):
    path, _ = written
    with open_messages(path, topics=['/tf', '/nothing']) as messages:
        read = list(messages)
        assert messages.channels == (('/tf', 'tf2_msgs/msg/TFMessage'),)
    expected = [sample for sample in samples if sample.channel.topic == '/tf']
    assert [bytes(each.data) for each in read] == [each.data for each in expected]
    with open_messages(path, topics=[]) as messages:
        assert list(messages) == []


@pytest.mark.one_in(3)
def test_rosbags_reads_every_message(written, samples):
    path, options = written
    ros1 = options.storage == 'ros1'
    ignored = {'texture_resource', 'texture', 'uv_coordinates', 'mesh_file'} if ros1 else set()
    with AnyReader(bag_files(path) if ros1 else [path]) as reader:
        read = list(reader.messages())
        assert [(each.topic, stamp_ns) for each, stamp_ns, _ in read] == [
            (each.channel.topic, each.stamp_ns) for each in samples
        ]
        for (connection, _, data), sample in zip(read, samples, strict=True):
            ours = jazzy().deserialize_cdr(sample.data, sample.channel.msgtype)
            assert_same(ours, reader.deserialize(data, connection.msgtype), ignored=ignored)


@cases('mcap', 'sqlite3')
def test_quality_of_service_and_type_hashes(written):
    path, _ = written
    with AnyReader([path]) as reader:
        connections = {each.topic: each for each in reader.connections}
    for channel in CHANNELS:
        (qos,) = connections[channel.topic].ext.offered_qos_profiles
        assert (qos.durability is QosDurability.TRANSIENT_LOCAL) == channel.latched
        assert qos.reliability is QosReliability.RELIABLE
        assert qos.depth == channel.depth
        if path.is_dir():
            assert connections[channel.topic].digest == jazzy().hash_rihs01(channel.msgtype)


@cases('ros1')
def test_ros1_definitions_are_ros1s_own(written):
    path, _ = written
    with AnyReader(bag_files(path)) as reader:
        for connection in reader.connections:
            latched = {each.topic: each.latched for each in CHANNELS}[connection.topic]
            assert connection.ext.latching == int(latched)
            if connection.msgtype in ROS1_MD5:
                assert connection.digest == ROS1_MD5[connection.msgtype]
            if connection.msgtype.endswith('CameraInfo'):
                assert 'float64[9] K' in connection.msgdef.data
                assert 'uint32 seq' in connection.msgdef.data


@cases('mcap')
def test_strict_mcap_readers_accept_it(written, samples):
    path, options = written
    decoded = 0
    for file in mcap_files(path):
        with file.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            assert reader.get_header().profile == 'ros2'
            summary = reader.get_summary()
            for schema, channel, message, _ in reader.iter_decoded_messages():
                assert schema.encoding == 'ros2msg'
                assert channel.message_encoding == 'cdr'
                assert channel.metadata['topic_type_hash'] == jazzy().hash_rihs01(schema.name)
                assert message.publish_time == message.log_time
                decoded += 1
            assert {each.compression for each in summary.chunk_indexes} == {
                '' if options.compression == 'none' else options.compression
            }
            stream.seek(0)
            sequences = Counter()
            for record in StreamReader(stream, validate_crcs=True).records:
                if type(record).__name__ == 'Message':
                    assert record.sequence == sequences[record.channel_id]
                    sequences[record.channel_id] += 1
            assert sequences == summary.statistics.channel_message_counts
    assert decoded == len(samples)


@cases('mcap')
def test_mcap_carries_rosbag2_metadata(written):
    path, _ = written
    files = mcap_files(path)
    with files[-1].open('rb') as stream:
        records = {each.name: each.metadata for each in make_reader(stream).iter_metadata()}
    assert records['kitti_ros2'] == SOURCE
    information = yaml.safe_load(records['rosbag2']['serialized_metadata'])
    assert information['version'] == 8
    assert information['relative_file_paths'] == [each.name for each in files]
    assert information['custom_data'] == SOURCE


def test_metadata_yaml_agrees_with_the_files(written, samples):
    path, options = written
    if path.is_file() or options.storage == 'ros1':
        assert not path.parent.joinpath('metadata.yaml').exists()
        return
    information = yaml.safe_load((path / 'metadata.yaml').read_text('utf-8'))[
        'rosbag2_bagfile_information'
    ]
    files = bag_files(path)
    assert information['version'] == 8
    assert information['ros_distro'] == 'jazzy'
    assert information['storage_identifier'] == options.storage
    assert information['relative_file_paths'] == [each.name for each in files]
    assert information['message_count'] == len(samples)
    assert information['starting_time'] == {'nanoseconds_since_epoch': START_NS}
    assert information['duration'] == {'nanoseconds': samples[-1].stamp_ns - START_NS}
    assert information['custom_data'] == SOURCE
    message_mode = options.storage == 'sqlite3' and options.compression == 'zstd'
    assert information['compression_mode'] == ('message' if message_mode else '')
    for entry in information['files']:
        summary = summarize_bag(path / entry['path'])
        assert entry['message_count'] == summary.message_count
        assert entry['starting_time']['nanoseconds_since_epoch'] == summary.start_ns
        assert entry['duration']['nanoseconds'] == summary.end_ns - summary.start_ns
    counts = {
        each['topic_metadata']['name']: each['message_count']
        for each in information['topics_with_message_count']
    }
    assert counts == Counter(sample.channel.topic for sample in samples)


def test_summary_counts_every_topic(written, samples):
    path, options = written
    summary = summarize_bag(path)
    assert summary.complete
    assert summary.problems == ()
    assert summary.start_ns == START_NS
    assert summary.end_ns == samples[-1].stamp_ns
    assert summary.compression == options.compression
    assert {each.name: each.count for each in summary.topics} == Counter(
        sample.channel.topic for sample in samples
    )
    cloud = next(each for each in summary.topics if each.name == '/kitti/velo/points')
    assert (cloud.median_period_ns, cloud.mean_rate_hz) == (100_000_000, 10.0)
    split = options.split_size is not None or options.split_duration_ns is not None
    assert (len(summary.files) > 1) == split


@cases('by size', 'by duration')
def test_split_keeps_its_promise(written):
    path, options = written
    for file in bag_files(path):
        summary = summarize_bag(file)
        assert summary.message_count
        if options.split_size is not None:
            assert summary.size_bytes < options.split_size + 200_000
        else:
            assert summary.end_ns - summary.start_ns < options.split_duration_ns


def test_a_large_message_has_a_file_of_its_own(tmp_path):
    samples = make_samples(rounds=2, cloud_bytes=300_000)
    path = write_bag(tmp_path / 'bag', BagOptions(split_size=1000), samples)
    with open_messages(path) as messages:
        assert [bytes(each.data) for each in messages] == [each.data for each in samples]
    assert all(summarize_bag(file).message_count for file in mcap_files(path))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_an_empty_bag_is_a_bag(tmp_path, storage):
    with open_bag(tmp_path / 'bag', BagOptions(storage=storage), jazzy()) as bag:
        bag.add_channel(CHANNELS[0])
    summary = summarize_bag(bag.path)
    assert summary.message_count == 0
    assert summary.start_ns is None
    with open_messages(bag.path) as messages:
        assert list(messages) == []


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_channels_may_come_late(tmp_path, compression):
    with open_bag(tmp_path / 'bag.mcap', BagOptions(compression=compression), jazzy()) as bag:
        for number in range(5):
            channel = bag.add_channel(Channel(f'/topic_{number}', 'std_msgs/msg/String'))
            bag.write(channel, number, [bytes((0, 1, 0, 0, 1, 0, 0, 0, 0))])
    with bag.path.open('rb') as stream:
        topics = [each[1].topic for each in make_reader(stream, validate_crcs=True).iter_messages()]
    assert topics == [f'/topic_{number}' for number in range(5)]


STRING = Channel('/text', 'std_msgs/msg/String')
payloads = st.one_of(st.binary(max_size=40), st.integers(4000, 9000).map(bytes))


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    messages=st.lists(
        st.tuples(st.integers(0, 2), st.integers(0, 2**62), st.lists(payloads, max_size=3))
    ),
    options=st.sampled_from(
        [
            BagOptions(overwrite=True),
            BagOptions(overwrite=True, compression='lz4'),
            BagOptions(overwrite=True, storage='sqlite3'),
            BagOptions(overwrite=True, split_size=9000),
        ]
    ),
)
def test_any_bytes_and_stamps_come_back(tmp_path, messages, options):
    """Storages do not look into messages, and stamps may come in any order.

    No CDR begins as zstd does, so that messages which rosbag2 has compressed are told by that.
    """
    assume(not any(b''.join(parts).startswith(ZSTD_MAGIC) for _, _, parts in messages))
    with open_bag(tmp_path / 'any', options, jazzy()) as bag:
        for number in range(3):
            bag.add_channel(Channel(f'/topic_{number}', 'std_msgs/msg/String'))
        for channel, stamp_ns, parts in messages:
            bag.write(channel, stamp_ns, parts)
    with open_messages(bag.path) as read:
        found = [(each.topic, each.stamp_ns, bytes(each.data)) for each in read]
    expected = [
        (f'/topic_{channel}', stamp_ns, b''.join(parts)) for channel, stamp_ns, parts in messages
    ]
    assert sorted(found) == sorted(expected)
    assert [each[1] for each in found] == sorted(each[1] for each in expected)
