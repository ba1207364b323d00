# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player as a WebSocket server for viewers; the only room that imports foxglove."""
