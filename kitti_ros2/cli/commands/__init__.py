# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments and help of each command; its implementation is imported when it is called."""
