# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""ROS 1 messages in MCAP, as `pymcap-cli bag2mcap` and mcap-ros1-support write them."""

from __future__ import annotations

import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Reader
from test_restore import back, files_of, to_bag

from kitti_ros2.bags.reader import open_messages


def rewritten(bag, out, latching):
    """A ROS 1 bag as MCAP; the latching of its connections is kept or, as by pymcap-cli, lost."""
    with Reader(bag) as reader, out.open('wb') as file:
        writer = Writer(file)
        writer.start(profile='ros1')
        channels = {}
        for connection in reader.connections:
            name = connection.msgtype.replace('/msg/', '/')
            schema = writer.register_schema(name, 'ros1msg', connection.msgdef.data.encode())
            metadata = {'latching': str(connection.ext.latching)} if latching else {}
            channels[connection.id] = writer.register_channel(
                connection.topic, 'ros1', schema, metadata
            )
        for connection, stamp_ns, data in reader.messages():
            writer.add_message(channels[connection.id], stamp_ns, data, stamp_ns)
        writer.finish()
    return out


@pytest.mark.parametrize('latching', [True, False])
def test_every_file_comes_back(recording_path, tmp_path, latching):
    bag = to_bag(recording_path, tmp_path, 'ros1')
    mcap = rewritten(bag, tmp_path / 'bag.mcap', latching)
    back(mcap, tmp_path / 'again')
    back(bag, tmp_path / 'expected')
    assert files_of(tmp_path / 'again') == files_of(tmp_path / 'expected')
    with open_messages(mcap) as messages:
        assert ('/tf_static' in messages.latched) == latching
