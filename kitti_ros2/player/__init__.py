# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What all players share, whatever carries their messages: sources, sessions, keys, state."""
