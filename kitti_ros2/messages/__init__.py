# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Samples to ROS messages and back: pure inverse pairs, and the table that names the topics."""
