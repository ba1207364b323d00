# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands say: lines for a terminal, paths and quantities as people read them."""

from __future__ import annotations

import sys
from pathlib import Path

from ..model.text import format_bytes, format_count, format_duration, one_line

__all__ = ['complain', 'format_bytes', 'format_count', 'format_duration', 'format_path', 'say']


def say(line: str) -> None:
    """A line on standard output; whatever is in it, it stays one line of plain text."""
    sys.stdout.write(f'{one_line(line)}\n')


def complain(line: str) -> None:
    """The same on standard error."""
    sys.stderr.write(f'{one_line(line)}\n')


def format_path(path: Path) -> str:
    """A path as the user would type it: relative where it is below the working folder."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
