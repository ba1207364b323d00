# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The checks of data sets and bags: tables of rules, each with its finding and remedy."""
