# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of data sets by the demands of programs of others that read KITTI.

Each reads a set as the program does, with none of our code, and returns the breaches, a line each
with the source of the demand: an empty list is a set that is accepted.
"""

from __future__ import annotations

from object_readers import check_mmdet3d, check_openpcdet, points_in_labels
from sequence_readers import check_evo, check_kiss_icp, check_pykitti

__all__ = [
    'check_evo',
    'check_kiss_icp',
    'check_mmdet3d',
    'check_openpcdet',
    'check_pykitti',
    'points_in_labels',
]
