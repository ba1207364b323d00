# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player: programs, playback, sessions, keyboard; and the rclpy node that publishes them."""
