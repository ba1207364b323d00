# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, ``kitti-ros2``: one error boundary.

Each sub-command has a module, which declares its words and options and runs it. Only the requested
one is imported, and what it works with only when it runs.
"""

from __future__ import annotations

from .boundary import main, player

__all__ = ['main', 'player']
