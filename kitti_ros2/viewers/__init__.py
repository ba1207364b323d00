# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in viewers: the player as a server for Foxglove, recordings and bags in Rerun.

Only this room imports their SDKs.
"""
