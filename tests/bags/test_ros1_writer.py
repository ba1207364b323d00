# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The writer of ROS 1 bags knows its connections without a search."""

from __future__ import annotations

import pytest
from rosbags.rosbag1.writer import WriterError

from kitti_ros2.bags.ros1_bag import Ros1Writer
from kitti_ros2.model.bag_formats import Channel

TEXT = 'string data\n', '992ce8a1687cec8c8bd883ec73ca41d1', None


def writer_of(path, topics):
    writer = Ros1Writer(path, 'none')
    writer.open()
    return writer, [writer.add(Channel(topic, 'std_msgs/msg/String'), *TEXT) for topic in topics]


def test_only_its_own_connections_are_written_to(tmp_path):
    writer, own = writer_of(tmp_path / 'a.bag', ['/a', '/b'])
    other, others = writer_of(tmp_path / 'b.bag', ['/a', '/b', '/c'])
    for connection in own:
        writer.write(connection, 1, b'\1\0\0\0x')
    for connection in others:
        with pytest.raises(WriterError, match='There is no connection'):
            writer.write(connection, 1, b'\1\0\0\0x')
    writer.close()
    other.abort()


def test_a_connection_is_looked_up_by_its_id(tmp_path):
    writer, (first, second) = writer_of(tmp_path / 'a.bag', ['/a', '/b'])
    # A search would find these at the wrong places.
    writer.connections.reverse()
    assert first not in writer.connections
    assert second not in writer.connections
    assert 'a' not in writer.connections
    writer.abort()
