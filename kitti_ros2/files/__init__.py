# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files on a disk: outputs that appear whole or not at all, the page cache, workers, PNG."""
