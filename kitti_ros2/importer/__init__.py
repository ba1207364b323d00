# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bag -> KITTI: our own bags to the byte, anyone's by a plan."""
