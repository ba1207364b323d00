# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of data sets and bags: tables of rules, each with a remedy."""
