# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the server of worker processes imports, once for all."""

from ..files.kept_imports import imports_of_a_worker

with imports_of_a_worker():
    from . import bag_unit, pool

__all__ = ['bag_unit', 'pool']
