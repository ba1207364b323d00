# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A process with two nodes: one owns map -> odom -> base_link, the other listens to all transforms.

    python tf_stack.py SCANS

The first answers each message of the topic SCANS with its two links at the same stamp. When the
standard input ends, what the listener heard is printed as JSON: [topic, parent, child, stamp,
length of the quaternion] of each transform.
"""

import json
import sys
import threading
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from kitti_ros2.messages.camera_info import make_transform
from kitti_ros2.messages.cdr import deserialize, join, peek_header, serialize, stamp_ns_of
from kitti_ros2.messages.ros_types import TYPESTORE, TFMessage
from kitti_ros2.model.bag_formats import CLOUD, TF
from kitti_ros2.model.geometry import Transform
from kitti_ros2.player.message_types import message_class

LINKS = (('map', 'odom'), ('odom', 'base_link'))


def make_stack(scans):
    """The node of a stack that estimates poses: always the origin."""
    node = rclpy.create_node('stack')
    kind = message_class(TF, TYPESTORE)
    publisher = node.create_publisher(kind, '/tf', QoSProfile(depth=100))

    def answer(data):
        stamp_ns, _ = peek_header(data)
        links = [make_transform(Transform.identity(), stamp_ns, *link) for link in LINKS]
        publisher.publish(join(serialize(TFMessage(links))))

    cloud = message_class(CLOUD, TYPESTORE)
    node.create_subscription(cloud, scans, answer, QoSProfile(depth=100), raw=True)
    return node


def make_listener(heard):
    """The node that collects the transforms of all others."""
    node = rclpy.create_node('tf_listener')
    kind = message_class(TF, TYPESTORE)

    def take(topic, data):
        for link in deserialize(data, TF).transforms:
            q = link.transform.rotation
            length = (q.x**2 + q.y**2 + q.z**2 + q.w**2) ** 0.5
            heard.append([
                topic, link.header.frame_id, link.child_frame_id, stamp_ns_of(link.header), length
            ])  # fmt: skip

    for topic, durability in (
        ('/tf', DurabilityPolicy.VOLATILE),
        ('/tf_static', DurabilityPolicy.TRANSIENT_LOCAL),
    ):
        node.create_subscription(
            kind,
            topic,
            lambda data, topic=topic: take(topic, data),
            QoSProfile(depth=100, durability=durability),
            raw=True,
        )
    return node


def main():
    rclpy.init()
    heard = []
    executor = SingleThreadedExecutor()
    for node in (make_stack(sys.argv[1]), make_listener(heard)):
        executor.add_node(node)

    def spin():
        with suppress(ExternalShutdownException):
            executor.spin()

    spinning = threading.Thread(target=spin, daemon=True)
    spinning.start()
    print('ready', flush=True)
    sys.stdin.read()
    print(json.dumps(heard), flush=True)
    rclpy.try_shutdown()
    spinning.join()


if __name__ == '__main__':
    main()
