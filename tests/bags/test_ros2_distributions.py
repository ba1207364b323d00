# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What each ROS 2 reads of a bag: QoS profiles, tables of sqlite3, type hashes, definitions.

Sources, in rosbag2's branches humble d256a5ba, iron a269cd41, jazzy 64717ee8, rolling 25304dd3:
metadata_io.cpp:65-76 (humble), yaml.hpp:103-118 (iron), yaml.hpp:125-143 (jazzy, rolling) of
rosbag2_storage for metadata.yaml; rosbag2_transport's qos.cpp:82-100 (humble, iron) and
rosbag2_storage's qos.cpp (jazzy, rolling) for the text of profiles, which containers also hold;
sqlite_storage.cpp (humble: of rosbag2_storage_default_plugins, others: of rosbag2_storage_sqlite3)
for the columns that are read. Kilted and Lyrical were branched off rolling later; of the time after
that, sqlite_storage.cpp and mcap_storage.cpp of commit 02860327 read the same.
"""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass

import pytest
import yaml
from bag_samples import CHANNELS, jazzy, make_samples, write_bag
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from test_convert import TOPICS as CONVERTED
from test_convert import write_ros2

from kitti_ros2.cli import main
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.options.outputs import BagOptions

POLICIES = ('history', 'reliability', 'durability', 'liveliness')
WORDS = {
    'history': ('system_default', 'keep_last', 'keep_all'),
    'reliability': ('system_default', 'reliable', 'best_effort'),
    'durability': ('system_default', 'transient_local', 'volatile'),
    'liveliness': ('system_default', 'automatic'),
}
"""The words of rmw/types.h, at the index of their numbers."""
BAGS = {
    'mcap file': ('bag.mcap', 'mcap'),
    'mcap': ('bag', 'mcap'),
    'sqlite3': ('bag', 'sqlite3'),
}


def numbers(profile):
    """The policies of a profile as Humble and Iron read them."""
    for name in POLICIES:
        if not isinstance(profile[name], int):
            raise TypeError(f'bad conversion of {name}')
    return [profile[name] for name in POLICIES]


def numbers_or_words(profile):
    """The same from Jazzy on: the history decides."""
    if isinstance(profile['history'], int):
        return numbers(profile)
    return [WORDS[name].index(profile[name]) for name in POLICIES]


@dataclass(frozen=True)
class Distribution:
    """How a ROS 2 reads profiles.

    Attributes:
        policies: The numbers of the policies of one profile.
        lists_from: The first version of metadata with a list, not a text, of profiles.
    """

    policies: object
    lists_from: int | None = None

    def of_text(self, text):
        return [self.policies(profile) for profile in yaml.safe_load(text)]

    def of_metadata(self, offered, version):
        if self.lists_from is not None and version >= self.lists_from:
            return [self.policies(profile) for profile in offered]
        if not isinstance(offered, str):
            raise TypeError('bad conversion of offered_qos_profiles')
        return self.of_text(offered)


DISTRIBUTIONS = {
    'humble': Distribution(numbers),
    'iron': Distribution(numbers),
    'jazzy': Distribution(numbers_or_words, lists_from=9),
    'rolling': Distribution(numbers_or_words, lists_from=9),
}


def metadata_texts(path):
    """The texts of a bag's metadata: metadata.yaml, and what its files hold of it."""
    if path.is_dir():
        yield (path / 'metadata.yaml').read_text('utf-8')
    for file in bag_files(path):
        if file.suffix == '.mcap':
            with file.open('rb') as stream:
                records = {
                    record.name: record.metadata for record in make_reader(stream).iter_metadata()
                }
            yield records['rosbag2']['serialized_metadata']
        else:
            with sqlite3.connect(file) as database:
                yield from (text for (text,) in database.execute('SELECT metadata FROM metadata'))


def channel_texts(path):
    """By topic the text of profiles that a file holds."""
    for file in bag_files(path):
        if file.suffix == '.mcap':
            with file.open('rb') as stream:
                for channel in make_reader(stream).get_summary().channels.values():
                    yield channel.topic, channel.metadata['offered_qos_profiles']
        else:
            with sqlite3.connect(file) as database:
                yield from database.execute('SELECT name, offered_qos_profiles FROM topics')


def bag_files(path):
    return [path] if path.is_file() else sorted({*path.iterdir()} - {path / 'metadata.yaml'})


@pytest.fixture(scope='module', params=BAGS)
def bag(request, tmp_path_factory):
    name, storage = BAGS[request.param]
    path = tmp_path_factory.mktemp('bags') / name
    return write_bag(path, BagOptions(storage=storage), make_samples(rounds=1, cloud_bytes=100))


@pytest.mark.parametrize('distribution', DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
def test_profiles_are_read_by_every_distribution(bag, distribution):
    expected = {channel.topic: [[1, 1, 1 if channel.latched else 2, 1]] for channel in CHANNELS}
    texts = list(metadata_texts(bag))
    assert len(texts) == 1 + bag.is_dir()
    for text in texts:
        information = yaml.safe_load(text)
        information = information.get('rosbag2_bagfile_information', information)
        topics = [row['topic_metadata'] for row in information['topics_with_message_count']]
        version = information['version']
        assert expected == {
            topic['name']: distribution.of_metadata(topic['offered_qos_profiles'], version)
            for topic in topics
        }
    assert expected == {topic: distribution.of_text(text) for topic, text in channel_texts(bag)}


@pytest.mark.parametrize('distribution', DISTRIBUTIONS.values(), ids=DISTRIBUTIONS)
@pytest.mark.parametrize('target', BAGS)
def test_profiles_of_a_bag_of_version_9_are_read_after_a_conversion(target, distribution, tmp_path):
    name, storage = BAGS[target]
    source, path = write_ros2(tmp_path / 'version9', StoragePlugin.MCAP), tmp_path / name
    words = ['--storage', storage] if storage == 'sqlite3' else []
    assert main(['to-bag', str(source), str(path), '-q', *words]) == 0
    expected = {
        topic: [[1, 1 if latched else 2, 1 if latched else 2, 1]]
        for topic, (_, latched) in CONVERTED.items()
    }
    assert expected == {topic: distribution.of_text(text) for topic, text in channel_texts(path)}


@pytest.mark.parametrize('name', ['humble', 'iron'])
def test_the_rules_tell_version_9_from_8(name):
    """A list of words is what these two refuse."""
    words = dict.fromkeys(POLICIES, 'system_default')
    with pytest.raises(TypeError, match='offered_qos'):
        DISTRIBUTIONS[name].of_metadata([words], 9)
    with pytest.raises(TypeError, match='history'):
        DISTRIBUTIONS[name].of_text(yaml.safe_dump([words]))


TYPES = {each.msgtype: jazzy().hash_rihs01(each.msgtype) for each in CHANNELS}
MESSAGES = {'messages': {'id', 'topic_id', 'timestamp', 'data'}}
TOPICS = {'name', 'type', 'serialization_format', 'offered_qos_profiles'}
SINCE_IRON = MESSAGES | {
    'schema': {'schema_version'},
    'metadata': {'id', 'metadata_version', 'metadata'},
    'topics': {'id', 'type_description_hash'} | TOPICS,
    'message_definitions': {
        'id', 'topic_type', 'encoding', 'encoded_message_definition', 'type_description_hash',
    },
}  # fmt: skip
COLUMNS = {
    'humble': MESSAGES | {'schema': {'schema_version', 'ros_distro'}, 'topics': {'id'} | TOPICS},
    'iron': SINCE_IRON,
    'jazzy': SINCE_IRON,
    'rolling': SINCE_IRON,
}
"""By distribution the columns that it reads of each table."""


@pytest.mark.parametrize('columns', COLUMNS.values(), ids=COLUMNS)
def test_sqlite3_has_the_columns_that_every_distribution_reads(tmp_path, columns):
    path = write_bag(tmp_path / 'bag', BagOptions(storage='sqlite3'), make_samples(rounds=1))
    with sqlite3.connect(*bag_files(path)) as database:
        for table, expected in columns.items():
            rows = database.execute('SELECT name FROM pragma_table_info(?)', [table])
            assert expected <= {name for (name,) in rows}
        assert database.execute('SELECT schema_version FROM schema').fetchall() == [(4,)]
        topics = dict(database.execute('SELECT name, type_description_hash FROM topics'))
    assert topics == {channel.topic: TYPES[channel.msgtype] for channel in CHANNELS}


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_the_type_hash_of_another_bag_is_that_of_ros(tmp_path, storage):
    """That of rosbags differs where there is a char; this one is of the std_msgs of Jazzy."""
    source, out = tmp_path / 'source.mcap', tmp_path / 'out'
    with source.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/Char', 'ros2msg', b'char data')
        channel = writer.register_channel('/char', 'cdr', schema)
        writer.add_message(channel, 10**9, b'\0\1\0\0a', 10**9)
        writer.finish()
    assert main(['to-bag', str(source), str(out), '--storage', storage, '-q']) == 0
    information = yaml.safe_load((out / 'metadata.yaml').read_text('utf-8'))
    (topic,) = information['rosbag2_bagfile_information']['topics_with_message_count']
    assert topic['topic_metadata']['type_description_hash'] == (
        'RIHS01_3ad2d04dd29ba19d04b16659afa3ccaedd691914b02a64e82e252f2fa6a586a9'
    )


@pytest.mark.parametrize('name', ['humble', 'iron', 'jazzy', 'kilted', 'lyrical'])
def test_messages_have_the_fields_of_every_distribution(name):
    """Lyrical's PointField and Humble's Marker have other constants, which no hash contains."""
    theirs = get_typestore(Stores[f'ROS2_{name.upper()}']).fielddefs
    shared = TYPESTORE.fielddefs.keys() & theirs.keys()
    assert {'sensor_msgs/msg/PointCloud2', 'visualization_msgs/msg/Marker'} <= shared
    for msgtype in shared:
        assert TYPESTORE.fielddefs[msgtype][1] == theirs[msgtype][1], msgtype
