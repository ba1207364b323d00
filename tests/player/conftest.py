# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The tests of the node talk on a domain of their own."""

import ros_domain  # noqa: F401 - sets the environment, before anything imports rclpy
