# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in viewers: the player as a server for Foxglove, recordings and bags in Rerun.

It is the only room that imports their SDKs.
"""
