# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of messages that are serialised already."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.messages.cdr import deserialize, join, restamp_message
from kitti_ros2.options.messages import Images, MarkerOptions, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.own_bags.encode import Encoder
from kitti_ros2.own_bags.schedule import make_schedule

STAMPS = st.integers(0, 2**31 * 10**9 - 1)
PATH = 'nav_msgs/msg/Path'


def headers(message, found=None):
    """Every header of a message, but of the poses of a path."""
    found = [] if found is None else found
    if message.__msgtype__ == 'std_msgs/msg/Header':
        found.append(message)
        return found
    for name in message.__dataclass_fields__:
        value = getattr(message, name)
        for each in value if isinstance(value, list) else [value]:
            if hasattr(each, '__dataclass_fields__') and each.__msgtype__[-11:] != 'PoseStamped':
                headers(each, found)
    return found


@pytest.fixture
def messages(recording):
    """One message of each type and its bytes."""
    schedule = make_schedule(recording, SelectionOptions())
    options = MessageOptions(images=Images.BOTH, markers=MarkerOptions(trails=True))
    encoder = Encoder(recording, schedule, options, SelectionOptions())
    made = {}
    for entry in schedule:
        for message in encoder.encode(entry)[0]:
            made[encoder.table[message.channel].msgtype] = join(message.parts)
    return made


def test_every_header_gets_the_stamp_and_nothing_else_changes(messages):
    stamp_ns = 1_234_567_890_123_456_789
    for msgtype, data in messages.items():
        again = restamp_message(data, msgtype, stamp_ns)
        assert len(again) == len(data)
        for header in headers(deserialize(again, msgtype)):
            stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
            # Texture and mesh of a marker have headers that nobody fills.
            assert stamp == stamp_ns, msgtype
        different = np.flatnonzero(np.frombuffer(again, 'u1') != np.frombuffer(data, 'u1'))
        assert len(different) <= 8 * len(headers(deserialize(data, msgtype)))


@given(STAMPS)
def test_a_text_has_no_stamp(stamp_ns):
    data = b'\0\1\0\0\2\0\0\0a\0\0\0'
    assert restamp_message(data, 'std_msgs/msg/String', stamp_ns) == data
