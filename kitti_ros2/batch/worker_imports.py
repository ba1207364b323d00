# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the server of worker processes imports, once for all: the units' functions and to-bag's."""

from ..files.kept_imports import imports_of_a_worker

with imports_of_a_worker():
    from ..bags import open_folder
    from ..exporter import to_bag
    from ..kitti import extract_oxts, predictions
    from ..options import selection, table
    from . import bag_unit, pool

__all__ = [
    'extract_oxts',
    'open_source',
    'pool',
    'predictions',
    'selection',
    'table',
    'to_bag',
    'unit_functions',
]
