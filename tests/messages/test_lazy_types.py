# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Functions of types that are made when they are needed: the same as rosbags makes at once."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.interfaces import Msgdef
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.stored_messages import typestore_of
from kitti_ros2.messages.type_definitions import LazyFunctions

from bags.bag_samples import random_message  # isort: skip

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

EAGER = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope='module')
def lazy() -> Typestore:
    return typestore_of(EAGER.fielddefs)


def test_a_type_has_all_that_rosbags_makes(lazy):
    made = lazy.get_msgdef('sensor_msgs/msg/PointCloud2')
    assert isinstance(made, LazyFunctions)
    expected = EAGER.get_msgdef('sensor_msgs/msg/PointCloud2')
    for each in fields(Msgdef):
        assert type(getattr(made, each.name)) is type(getattr(expected, each.name))
    assert (made.name, made.fields) == (expected.name, expected.fields)
    assert (made.size_cdr, made.size_ros1) == (expected.size_cdr, expected.size_ros1)
    with pytest.raises(AttributeError):
        _ = made.another


def test_functions_are_made_once_and_only_those_needed():
    store = typestore_of({'a_msgs/msg/A': ([], EAGER.fielddefs['std_msgs/msg/String'][1])})
    store.deserialize_cdr(b'\0\1\0\0\2\0\0\0a\0', 'a_msgs/msg/A')
    made = store.get_msgdef('a_msgs/msg/A')
    assert made.deserialize_cdr_le is made.deserialize_cdr_le
    assert set(vars(made)) == {'name', 'fields', 'store', 'cls', 'deserialize_cdr_le'}
    with pytest.raises(KeyError):
        store.get_msgdef('a_msgs/msg/B')


# The byte of rosbags is signed, that of random messages is not.
WITH_BYTES = {
    name for name in EAGER.fielddefs if 'byte' in str(EAGER.generate_msgdef(name, ros_version=2)[0])
}


@pytest.mark.parametrize('msgtype', sorted(EAGER.fielddefs.keys() - WITH_BYTES))
def test_every_type_of_ros_is_converted_as_by_rosbags(msgtype, lazy):
    rng = np.random.default_rng(len(msgtype))
    message = random_message(EAGER, msgtype, rng)
    for little_endian in (True, False):
        data = EAGER.serialize_cdr(message, msgtype, little_endian=little_endian)
        ours = lazy.deserialize_cdr(data, msgtype)
        assert lazy.serialize_cdr(ours, msgtype, little_endian=little_endian) == data
    data = EAGER.serialize_cdr(message, msgtype)
    ros1 = EAGER.cdr_to_ros1(data, msgtype)
    assert lazy.cdr_to_ros1(data, msgtype) == ros1
    assert lazy.ros1_to_cdr(ros1, msgtype) == EAGER.ros1_to_cdr(ros1, msgtype)
    expected = EAGER.serialize_ros1(message, msgtype)
    ours = lazy.deserialize_ros1(expected, msgtype)
    assert lazy.serialize_ros1(ours, msgtype) == expected
