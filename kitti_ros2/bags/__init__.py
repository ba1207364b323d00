# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags: one interface to write MCAP, rosbag2 sqlite3 and ROS 1 .bag, and one to read them."""
