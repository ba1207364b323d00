# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Bag -> KITTI, by a plan. own_bags/ restores the bags that to-bag wrote."""
