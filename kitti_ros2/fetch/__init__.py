# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Archives of KITTI: downloaded, resumed, unpacked into the trees that readers expect."""
