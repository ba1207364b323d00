# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Values that all other rooms use: errors, stamps, geometry, boxes, samples, recordings."""
