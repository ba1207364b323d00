# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a stack receives: messages by topic, types and QoS, clouds as columns, the tree."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import yaml

from kitti_ros2.bags.file_writer import qos_profile
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.messages.cdr import deserialize, join
from kitti_ros2.player.program import RecordingProgram

INT8, UINT8, INT16, UINT16, INT32, UINT32, FLOAT32, FLOAT64 = range(1, 9)
"""Types of sensor_msgs/PointField."""
KINDS = dict(zip(range(1, 9), ('i1', 'u1', 'i2', 'u2', 'i4', 'u4', 'f4', 'f8'), strict=True))


@dataclass(frozen=True)
class Seen:
    """All messages of a run.

    Attributes:
        types: By topic.
        qos: Offered, by topic.
        messages: Decoded, by topic, in their order.
    """

    types: dict
    qos: dict
    messages: dict

    def clouds(self, topic):
        """The clouds of a topic."""
        return [SeenCloud(message) for message in self.messages[topic]]

    @cached_property
    def static(self):
        """Child to parent of /tf_static."""
        return self._links('/tf_static')

    @cached_property
    def moving(self):
        """Child to parent of /tf."""
        return self._links('/tf')

    def _links(self, topic):
        links = defaultdict(set)
        for message in self.messages.get(topic, []):
            for each in message.transforms:
                links[each.child_frame_id].add(each.header.frame_id)
        return dict(links)

    def above(self, frame, links):
        """The frame and those above it."""
        found = [frame]
        while found[-1] in links:
            found.append(min(links[found[-1]]))
            assert len(found) < 100, 'a ring of frames'
        return found


class SeenCloud:
    """A PointCloud2, by its own fields."""

    def __init__(self, message):
        self.message = message
        self.fields = {each.name: (each.datatype, each.offset) for each in message.fields}
        assert all(each.count == 1 for each in message.fields)
        self.stamp_ns = stamp_ns(message)
        point = np.dtype({
            'names': list(self.fields),
            'formats': [f'<{KINDS[kind]}' for kind, _ in self.fields.values()],
            'offsets': [offset for _, offset in self.fields.values()],
            'itemsize': message.point_step,
        })  # fmt: skip
        self.points = np.frombuffer(bytes(message.data), point)
        assert len(self.points) == message.width * message.height

    def seconds(self, name):
        """Times of the points since the stamp: whole numbers are nanoseconds."""
        values = self.points[name].astype(np.float64)
        return values if self.fields[name][0] in {FLOAT32, FLOAT64} else values / 1e9


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def seen_in_bag(path):
    """What is in a bag, a folder."""
    types, found = {}, defaultdict(list)
    with open_messages(path) as messages:
        for each in messages:
            types[each.topic] = each.msgtype
            found[each.topic].append(deserialize(bytes(each.data), each.msgtype))
    listed = yaml.safe_load((path / 'metadata.yaml').read_text('utf-8'))
    rows = listed['rosbag2_bagfile_information']['topics_with_message_count']
    topics = [each['topic_metadata'] for each in rows]
    qos = {each['name']: _profile(each['offered_qos_profiles']) for each in topics}
    return Seen(types, qos, dict(found))


def _profile(offered):
    profiles = yaml.safe_load(offered) if isinstance(offered, str) else offered
    assert len(profiles) == 1
    return profiles[0]


def seen_live(recording, options, selection):
    """What the player publishes, to subscribers of all topics."""
    program = RecordingProgram(recording, options, selection, 2)
    channels = list(program.channels)
    found = defaultdict(list)
    for index in range(len(program.stamps_ns)):
        due, losses = program.fetch(index, range(len(channels)))
        assert losses == []
        for each in due:
            channel = channels[each.channel]
            found[channel.topic].append(deserialize(join(each.parts), channel.msgtype))
    types = {each.topic: each.msgtype for each in channels}
    return Seen(types, {each.topic: qos_profile(each) for each in channels}, dict(found))
