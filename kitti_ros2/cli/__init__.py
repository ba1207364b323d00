# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command line, ``kitti-ros2``: one error boundary.

commands/ declares the words and options of each sub-command, which is all that --help imports; the
module of the same name beside it runs the command.
"""

from __future__ import annotations

from .boundary import main, player

__all__ = ['main', 'player']
