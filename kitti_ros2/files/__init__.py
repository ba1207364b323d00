# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Files: outputs that appear complete or not at all, the page cache, worker threads, PNG."""
