# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A check for ROS; for the modules that import it."""

from __future__ import annotations

import os
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from ..model.errors import UsageError

_JAZZY, _KILTED = 7, 9
_DISTRIBUTIONS = {3: 'humble', 4: 'iron', _JAZZY: 'jazzy', _KILTED: 'kilted'}
"""By the major version of rclpy."""
_WHEELS = {'jazzy', 'kilted'}
"""The distributions whose wheels are on PyPI."""


def middleware() -> str:
    """Return the name of the middleware that ROS will load."""
    return os.environ.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'


def distribution() -> str:
    """Return the name of the ROS 2 that is installed, such as jazzy."""
    return os.environ.get('ROS_DISTRO') or _DISTRIBUTIONS.get(_rclpy_major(), 'rolling')


def fast_dds_version() -> int:
    """Return the major version of Fast DDS that comes with the ROS 2 that is installed."""
    return 3 if _rclpy_major() >= _KILTED else 2


def _rclpy_major() -> int:
    try:
        return int(metadata.version('rclpy').partition('.')[0])
    except (metadata.PackageNotFoundError, ValueError):
        return _JAZZY


def check_installed() -> None:
    """Check that ROS and its middleware are installed; call before rclpy is imported.

    Without its middleware rcl ends the process on import, without an exception.

    Raises:
        UsageError: rclpy or its middleware is missing.
    """
    if find_spec('rclpy') is None:
        raise UsageError(
            'play needs rclpy, which is not installed; source a ROS 2 workspace, or run pip install'
            " 'kitti_ros2[ros]'"
        )
    name = middleware()
    if find_spec(name) is not None or any(
        (folder / f'lib{name}.so').exists() for folder in _library_folders()
    ):
        return
    package = f'ros-{distribution()}-' + name.replace('_', '-')
    if 'RMW_IMPLEMENTATION' in os.environ:
        raise UsageError(
            f'the middleware {name} is not installed; install {package}, or unset'
            f' RMW_IMPLEMENTATION for the default one'
        )
    wheel = f", or run pip install 'ros-{distribution()}-rclpy[fastrtps]'"
    raise UsageError(
        f'no middleware is installed; install {package}{wheel * (distribution() in _WHEELS)}'
    )


def _library_folders() -> list[Path]:
    """Return the folders that may contain shared libraries of ROS."""
    workspaces = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    libraries = os.environ.get('LD_LIBRARY_PATH', '').split(os.pathsep)
    return [
        *(Path(workspace) / 'lib' for workspace in workspaces if workspace),
        *map(Path, filter(None, libraries)),
    ]
