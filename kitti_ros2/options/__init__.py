# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options: frozen objects with their defaults and their validation, whoever fills them in."""
