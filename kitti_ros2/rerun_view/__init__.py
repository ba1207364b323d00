# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a recording or of any bag in Rerun; the only importer of its SDK."""
