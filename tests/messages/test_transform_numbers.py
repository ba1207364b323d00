# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The transforms in the bytes of a TFMessage, as rosbags writes them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.messages.oxts import read_transforms

STORE = get_typestore(Stores.ROS2_HUMBLE)
T = STORE.types
KIND = 'tf2_msgs/msg/TFMessage'
NAMES = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
NUMBERS = st.tuples(*[st.floats(allow_nan=False)] * 7)
LINKS = st.lists(st.tuples(st.integers(0, 2**31 - 1), NAMES, NAMES, NUMBERS), max_size=4)


def message(links):
    made = []
    for sec, parent, child, numbers in links:
        header = T['std_msgs/msg/Header'](T['builtin_interfaces/msg/Time'](sec, 7), parent)
        place = T['geometry_msgs/msg/Vector3'](*numbers[:3])
        turn = T['geometry_msgs/msg/Quaternion'](*numbers[3:])
        moved = T['geometry_msgs/msg/Transform'](place, turn)
        made.append(T['geometry_msgs/msg/TransformStamped'](header, child, moved))
    return T[KIND](made)


@given(LINKS, st.booleans())
def test_they_are_read_as_they_were_written(links, little):
    data = STORE.serialize_cdr(message(links), KIND, little_endian=little)
    found = [tuple(each) for each in read_transforms(data)]
    assert found == [(sec * 10**9 + 7, *rest) for sec, *rest in links]


def test_a_truncated_message_is_refused():
    data = STORE.serialize_cdr(message([(1, 'map', 'odom', (0.0,) * 7)]), KIND)
    for length in range(4, len(data)):
        with pytest.raises(ValueError, match='is truncated'):
            read_transforms(bytes(data[:length]))


def test_a_count_that_cannot_be_is_refused():
    with pytest.raises(ValueError, match='is truncated'):
        read_transforms(b'\0\1\0\0' + np.array([2**32 - 1], '<u4').tobytes())
