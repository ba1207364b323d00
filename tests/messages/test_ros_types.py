# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Our definitions are ROS 2's own."""

import pytest
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.messages.ros_types import TYPESTORE

JAZZY = get_typestore(Stores.ROS2_JAZZY)
SHARED = sorted(name for name in TYPESTORE.fielddefs if name in JAZZY.fielddefs)


def test_every_type_but_those_of_vision_msgs_can_be_compared():
    alone = {name.split('/')[0] for name in TYPESTORE.fielddefs if name not in SHARED}
    assert alone == {'vision_msgs'}
    assert len(SHARED) > 25


@pytest.mark.parametrize('msgtype', SHARED)
def test_a_definition_equals_jazzys(msgtype):
    """Fields, constants and hash, in their order."""
    assert TYPESTORE.fielddefs[msgtype] == JAZZY.fielddefs[msgtype]
    assert TYPESTORE.hash_rihs01(msgtype) == JAZZY.hash_rihs01(msgtype)
    ours, theirs = TYPESTORE.types[msgtype], JAZZY.types[msgtype]
    assert list(ours.__dataclass_fields__) == list(theirs.__dataclass_fields__)
    for name, _, value in TYPESTORE.fielddefs[msgtype][0]:
        assert getattr(ours, name) == value
