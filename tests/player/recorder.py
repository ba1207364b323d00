# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A second process that subscribes as `ros2 bag record -a` does: to every topic that it discovers.

    python recorder.py [OUT.mcap]

It looks for topics ten times a second, as rosbag2 does by default, and subscribes to what is new,
one topic after the other, with the durability that is offered. It prints how many messages came by
topic when its standard input ends, and writes the messages to a bag if one is named.
"""

import json
import sys
import threading
import time
from pathlib import Path

import rclpy
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.player.message_types import message_class

LOOK_EVERY_S = 0.1


class Recorder:
    def __init__(self):
        rclpy.init()
        self.node = rclpy.create_node('recorder')
        self.subscriptions = {}
        self.counts = {}
        self.types = {}
        self.taken = []

    def look(self):
        for topic, (msgtype, *_) in self.node.get_topic_names_and_types():
            offered = self.node.get_publishers_info_by_topic(topic)
            if topic in self.counts or not offered:
                continue
            try:
                kind = message_class(msgtype, TYPESTORE)
            except MissingDataError:
                continue
            self.counts[topic] = 0
            self.types[topic] = msgtype
            profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
            if all(each.qos_profile.durability is offers_history for each in offered):
                profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
            self.subscriptions[topic] = self.node.create_subscription(
                kind, topic, lambda _: None, profile, raw=True
            )

    def take(self):
        for topic, subscription in self.subscriptions.items():
            while taken := subscription.handle.take_message(subscription.msg_type, True):
                self.counts[topic] += 1
                self.taken.append((topic, time.time_ns(), taken[0]))

    def write(self, path):
        with open_bag(path, BagOptions(), TYPESTORE) as writer:
            channels = {}
            for topic, stamp_ns, data in self.taken:
                if topic not in channels:
                    channels[topic] = writer.add_channel(Channel(topic, self.types[topic]))
                writer.write(channels[topic], stamp_ns, (data,))


offers_history = DurabilityPolicy.TRANSIENT_LOCAL


def main():
    recorder = Recorder()
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    while not ended.wait(LOOK_EVERY_S):
        recorder.look()
        recorder.take()
    recorder.take()
    if sys.argv[1:]:
        recorder.write(Path(sys.argv[1]))
    print(json.dumps(recorder.counts), flush=True)
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
