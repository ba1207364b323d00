# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""KITTI recordings in ROS 2: played live, written to bags, and read back from bags."""

from __future__ import annotations


def __getattr__(name: str) -> str:
    """Look the version up when it is asked for: importlib.metadata would slow every start."""
    if name != '__version__':
        message = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(message)
    from importlib import metadata  # noqa: PLC0415

    try:
        return metadata.version(__name__)
    except metadata.PackageNotFoundError:
        return '0+not-installed'
