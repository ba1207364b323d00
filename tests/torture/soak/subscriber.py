# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Subscribers that come and go, one after the other: a line of JSON for each that has left.

    python subscriber.py SEED LONGEST_S slow|fast

Each is a node of its own that subscribes to a third of the player's topics, and to that of the bare
publisher, for a random time. A slow one takes two messages a second.
"""

import json
import random
import sys
import time

import rclpy
from rclpy.context import Context
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.player.message_types import message_class

from bare_publisher import TOPIC  # isort: skip

LOOK_EVERY_S = 0.05
SLOW_S = 0.5
OURS = ('/kitti', '/tf', '/clock')


def topics_of(node):
    """The topics that the player publishes, with their classes."""
    found = {}
    for topic, (msgtype, *_) in node.get_topic_names_and_types():
        if topic.startswith(OURS) and node.count_publishers(topic):
            try:
                found[topic] = message_class(msgtype, TYPESTORE)
            except MissingDataError:
                continue
    return found


def subscribe(node, topic, kind):
    """A subscription whose messages are taken, not called back."""
    return node.create_subscription(kind, topic, lambda _: None, QoSProfile(depth=20), raw=True)


def live(chance, longest_s, slow):
    """One subscriber, from its birth to its end; how many messages it took."""
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node(f'soak_{chance.randrange(10**9)}', context=context)
    end = time.monotonic() + chance.uniform(longest_s / 10, longest_s)
    subscriptions, taken = [], 0
    try:
        while time.monotonic() < end:
            found = {} if subscriptions else topics_of(node)
            if found:
                chosen = chance.sample(sorted(found), k=-(-len(found) // 3))
                subscriptions = [subscribe(node, topic, found[topic]) for topic in chosen]
                subscriptions.append(subscribe(node, TOPIC, Header))
            for each in subscriptions:
                while each.handle.take_message(each.msg_type, True):
                    taken += 1
                    if slow:
                        break
            time.sleep(SLOW_S if slow else LOOK_EVERY_S)
    finally:
        node.destroy_node()
        context.shutdown()
    return taken


def main(seed, longest_s, speed):
    chance = random.Random(int(seed))
    while True:
        taken = live(chance, float(longest_s), speed == 'slow')
        print(json.dumps({'taken': taken}), flush=True)


if __name__ == '__main__':
    main(*sys.argv[1:])
