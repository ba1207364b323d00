# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras and coordinate frames of any robot: the TF tree, stereo pairs, rectification."""
