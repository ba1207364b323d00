# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Imports are not collected as garbage."""

from __future__ import annotations

import gc


def keep_imports() -> None:
    """Enable the collector that boundary.main disabled, without the objects of imports.

    Where main is called as a function, it is enabled, and what it has not collected yet stays its.
    """
    if not gc.isenabled():
        gc.freeze()
        gc.enable()
