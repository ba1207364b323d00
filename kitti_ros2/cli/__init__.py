# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, ``kitti-ros2``: one file per sub-command, one error boundary."""

from __future__ import annotations

from .boundary import main, player

__all__ = ['main', 'player']
