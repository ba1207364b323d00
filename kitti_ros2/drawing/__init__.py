# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of boxes, points and bird's-eye views into numpy images."""
