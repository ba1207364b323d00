# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player that viewers connect to by WebSocket; the only room that imports foxglove."""
