# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Whole collections: jobs, the manifest of what is done, and worker processes."""
