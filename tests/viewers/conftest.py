# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of single messages, and what Rerun makes of them."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.cdr import join, serialize
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.player.bag_program import BagProgram


def every_type():
    """The types of ROS 2 Jazzy, of vision_msgs and of Foxglove."""
    store = get_typestore(Stores.ROS2_JAZZY)
    names = [name for name in TYPESTORE.fielddefs if name.startswith(('vision', 'foxglove'))]
    store.register({name: TYPESTORE.fielddefs[name] for name in names})
    return store


@pytest.fixture
def show_messages(tmp_path):
    """A function that shows messages, (topic, stamp, message, latched), of a bag made of them.

    A message that is serialised already comes as (type, bytes).
    """
    from read_rrd import show_in  # noqa: PLC0415 - it needs the SDK

    def show(*messages):
        number = len(list(tmp_path.glob('*.mcap')))
        bag = tmp_path / f'{number}.mcap'
        with open_bag(bag, BagOptions(), every_type()) as writer:
            channels = {}
            for topic, stamp_ns, message, *latched in messages:
                kind, data = (
                    message
                    if isinstance(message, tuple)
                    else (message.__msgtype__, join(serialize(message)))
                )
                if topic not in channels:
                    channel = Channel(topic, kind, latched=bool(latched), depth=1)
                    channels[topic] = writer.add_channel(channel)
                writer.write(channels[topic], stamp_ns, (data,))
        return show_in(tmp_path / f'{number}.rrd', BagProgram(bag, SelectionOptions()))

    return show
