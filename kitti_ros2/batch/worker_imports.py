# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the server of worker processes imports, once for all: the units' functions and to-bag's."""

from ..files.processes import imports_of_a_worker

with imports_of_a_worker():
    from ..bags import open_source
    from ..batch import pool, unit_functions
    from ..kitti import extract_oxts, prepare
    from ..options import read, table
    from ..own_bags import to_bag

__all__ = [
    'extract_oxts',
    'open_source',
    'pool',
    'prepare',
    'read',
    'table',
    'to_bag',
    'unit_functions',
]
