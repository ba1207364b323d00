# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Imports of the server of a local Dask cluster's worker processes."""

from importlib import import_module

from ..files.processes import imports_of_a_worker

with imports_of_a_worker():
    import_module('distributed.nanny')
    from ..batch import dask_cluster, worker_imports

__all__ = ['dask_cluster', 'worker_imports']
