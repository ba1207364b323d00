# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A publisher that does nothing else: what the middleware misses by itself.

It publishes one small message a hundred times a second, to the subscribers that the player has, and
prints one line of JSON a second, until it is terminated.
"""

import rclpy
from std_msgs.msg import Header

from bare_timer import tick  # isort: skip

TOPIC = '/soak/bare'


def main():
    rclpy.init()
    node = rclpy.create_node('soak_publisher')
    publisher = node.create_publisher(Header, TOPIC, 10)
    message = Header(frame_id='bare')
    tick(lambda: publisher.publish(message))


if __name__ == '__main__':
    main()
