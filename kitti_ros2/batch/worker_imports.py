# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Imports of the server of worker processes: functions of jobs, and those of to-bag."""

from ..files.processes import imports_of_a_worker

with imports_of_a_worker():
    from ..bags import open_source
    from ..batch import job_functions, pool
    from ..kitti import extract_oxts, prepare
    from ..options import read, table
    from ..own_bags import to_bag

__all__ = [
    'extract_oxts',
    'job_functions',
    'open_source',
    'pool',
    'prepare',
    'read',
    'table',
    'to_bag',
]
