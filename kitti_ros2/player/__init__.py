# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player, independent of the transport: sources, sessions, keyboard, state."""
