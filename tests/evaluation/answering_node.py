# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A node that answers scans with a box, or misbehaves.

    python answering_node.py BEHAVIOUR

See the functions of Behaviours.
"""

import os
import subprocess
import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException

from kitti_ros2.messages.cdr import peek_header
from kitti_ros2.messages.detections import encode_detections
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import CLOUD, DETECTIONS_3D
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.geometry import Transform
from kitti_ros2.player.message_types import message_class

BOX = Cuboid('Car', '0', Transform.from_translation((10, 2, -0.9)), (4.0, 1.6, 1.5), 0.9)


class Behaviours:
    """By name: called with the stamp of each scan."""

    def __init__(self, publish):
        self._publish = publish
        self._stamps = []

    def all(self, stamp_ns):
        self._publish(stamp_ns)

    def late(self, stamp_ns):
        """Answers a scan when it has the next one."""
        self._stamps.append(stamp_ns)
        if len(self._stamps) > 1:
            self._publish(self._stamps[-2])

    def crash(self, stamp_ns):
        """Fails at its third scan."""
        self._stamps.append(stamp_ns)
        if len(self._stamps) == 3:
            print('out of memory', flush=True)
            os.abort()
        self._publish(stamp_ns)

    def silent(self, stamp_ns):
        """Never answers."""

    def family(self, stamp_ns):
        """Starts another process at its first scan, and never answers."""
        if not self._stamps:
            child = subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])
            print(f'processes {os.getpid()} {child.pid}.', flush=True)
        self._stamps.append(stamp_ns)


def main(behaviour):
    if behaviour == 'exit':
        sys.exit('no module named torch')
    rclpy.init()
    node = rclpy.create_node('answering')
    publisher = node.create_publisher(
        message_class(DETECTIONS_3D, TYPESTORE), '/answering/boxes', 10
    )

    def publish(stamp_ns):
        (data,) = encode_detections([BOX], stamp_ns, 'velo_link')
        publisher.publish(bytes(data))

    answer = getattr(Behaviours(publish), behaviour)
    node.create_subscription(
        message_class(CLOUD, TYPESTORE),
        '/kitti/velo/points',
        lambda data: answer(peek_header(data)[0]),
        10,
        raw=True,
    )
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main(*sys.argv[1:])
