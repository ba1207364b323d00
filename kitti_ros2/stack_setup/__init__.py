# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a stack needs to run on a drive: parameter files, a launch file, commands."""
