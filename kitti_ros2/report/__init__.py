# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The overview of a recording or a bag that `info` prints, and the report: one HTML page."""
