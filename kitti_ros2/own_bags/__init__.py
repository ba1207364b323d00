# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bags that to-bag wrote: their messages under KITTI's file numbers, and back to the byte."""
