# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whole collections: units of work, the manifest of what is done, and worker processes."""
