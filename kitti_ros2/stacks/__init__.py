# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Programs of others that consume KITTI in ROS 2, and what each demands of its messages."""
