# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Pixels: boxes, points and bird's-eye views drawn into images that are numpy arrays."""
