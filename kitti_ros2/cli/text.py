# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Paths and quantities as people read them."""

from __future__ import annotations

from pathlib import Path

from ..quantities import format_bytes, format_count, format_duration

__all__ = ['format_bytes', 'format_count', 'format_duration', 'format_path']


def format_path(path: Path) -> str:
    """A path as the user would type it: relative where it is below the working folder."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
