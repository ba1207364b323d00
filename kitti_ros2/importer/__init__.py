# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bag -> KITTI: bags written by to-bag byte for byte, others by a plan."""
