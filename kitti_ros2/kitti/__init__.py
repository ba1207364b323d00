# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of KITTI's files and layouts, without ROS."""
