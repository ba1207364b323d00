# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What each command takes, and its help; what it does is imported only when it is called."""
