# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: lines for a terminal, readable paths and quantities."""

from __future__ import annotations

import sys
from pathlib import Path

from ..model.text import format_bytes, format_count, format_duration, one_line

__all__ = ['complain', 'format_bytes', 'format_count', 'format_duration', 'format_path', 'say']


def say(line: str) -> None:
    """Print on standard output as one line of plain text, whatever the characters."""
    sys.stdout.write(f'{one_line(line)}\n')


def complain(line: str) -> None:
    """Print on standard error as one line of plain text."""
    sys.stderr.write(f'{one_line(line)}\n')


def format_path(path: Path) -> str:
    """Return a path, relative if it is below the working directory."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
