# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is true of cameras and coordinate frames, whichever way data goes."""
