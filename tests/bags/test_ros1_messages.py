# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lengths in messages of ROS 1 that are damaged are refused, at the cost of the message."""

import struct

import pytest
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.stored_messages import ros1_to_cdr

STORE = get_typestore(Stores.ROS2_JAZZY)
HEADER = struct.pack('<III', 1, 2, 3) + struct.pack('<I', 1) + b'a'


def lengths_at(data):
    """Positions at which any four bytes may be a length."""
    return range(len(data) - 3)


@pytest.mark.parametrize(
    ('msgtype', 'data'),
    [
        ('geometry_msgs/msg/PoseArray', HEADER + struct.pack('<I', 1) + bytes(7 * 8)),
        ('visualization_msgs/msg/MarkerArray', struct.pack('<I', 0)),
        ('sensor_msgs/msg/PointCloud', HEADER + struct.pack('<I', 1) + bytes(12 + 4)),
        ('tf2_msgs/msg/TFMessage', struct.pack('<I', 1) + HEADER + bytes(4 + 7 * 8)),
        ('nav_msgs/msg/Path', HEADER + struct.pack('<I', 1) + HEADER + bytes(7 * 8)),
    ],
    ids=['PoseArray', 'MarkerArray', 'PointCloud', 'TFMessage', 'Path'],
)
@pytest.mark.parametrize('length', [2**32 - 1, 2**31, 10**8])
def test_a_damaged_length_is_refused(msgtype, data, length):
    assert ros1_to_cdr(STORE, data, msgtype)
    for place in lengths_at(data):
        damaged = data[:place] + struct.pack('<I', length) + data[place + 4 :]
        try:
            ros1_to_cdr(STORE, damaged, msgtype)
        except (SerdeError, struct.error):
            continue
        assert len(damaged) == len(data)  # it was a number, such as a coordinate
    assert STORE.max_sequence_length == 2**32 - 1
