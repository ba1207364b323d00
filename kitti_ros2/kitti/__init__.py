# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The disk side: KITTI's files and layouts, read and written with numpy alone."""
