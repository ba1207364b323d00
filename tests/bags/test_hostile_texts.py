# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Values in bags, and beside them, that their recorders do not write."""

import pytest
from mcap.writer import Writer

from kitti_ros2.bags.offered_qos import offered_qos, qos_faults
from kitti_ros2.bags.reader import open_messages, summarize_bag

METADATA = """rosbag2_bagfile_information:
  storage_identifier: mcap
  relative_file_paths: {paths}
  message_count: {count}
"""


@pytest.fixture
def folder(tmp_path):
    """A directory of rosbag2, without metadata.yaml."""
    with (tmp_path / 'a_0.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/t', 'cdr', schema)
        writer.add_message(channel, 1, b'\0\1\0\0\1\0\0\0\0', 1)
        writer.finish()
    return tmp_path


@pytest.mark.parametrize('count', ['.inf', '-.inf', '.nan', '{}', 'many'])
def test_a_count_that_is_no_number_is_named_and_the_files_are_read(folder, count):
    (folder / 'metadata.yaml').write_text(METADATA.format(paths='[a_0.mcap]', count=count))
    summary = summarize_bag(folder)
    assert [topic.count for topic in summary.topics] == [1]
    assert 'is no metadata of rosbag2' in summary.findings[0]


def test_a_name_that_no_file_can_have_is_a_missing_file(folder):
    long = 'a' * 300
    (folder / 'metadata.yaml').write_text(METADATA.format(paths=f'[a_0.mcap, {long}]', count=1))
    summary = summarize_bag(folder)
    assert [topic.count for topic in summary.topics] == [1]
    assert any(f'{long} is missing' in finding for finding in summary.findings)


@pytest.mark.parametrize('depth', ['.inf', '-.inf', '.nan', '[]', '1e300'])
def test_a_depth_that_is_no_number_is_unknown(depth):
    profiles = f'- durability: transient_local\n  depth: {depth}\n'
    known = offered_qos('- durability: transient_local\n')
    assert {**offered_qos(profiles), 'profiles': ''} == {**known, 'profiles': ''}


@pytest.mark.parametrize('value', ['1.0', '[1]', '{}', '.nan'])
def test_a_policy_that_is_no_whole_number_is_a_fault(value):
    (fault,) = qos_faults(f'- history: {value}\n  reliability: 1\n  durability: 2\n  liveliness: 1')
    assert fault.startswith('history of a publisher is ')


def test_a_log_time_beyond_int64_is_the_last_one(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/t', 'cdr', schema)
        for stamp_ns in (5, 2**63 - 1, 2**63, 2**64 - 1):
            writer.add_message(channel, stamp_ns, b'\0\1\0\0\1\0\0\0\0', 1)
        writer.finish()
    with open_messages(path) as messages:
        assert [each.stamp_ns for each in messages] == [5, *[2**63 - 1] * 3]
        assert not messages.losses
