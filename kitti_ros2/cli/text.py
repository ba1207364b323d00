# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands say: lines for a terminal, and numbers as people read them."""

from __future__ import annotations

import sys
from pathlib import Path

from ..one_line import one_line


def say(line: str) -> None:
    """A line on standard output; whatever is in it, it stays one line of plain text."""
    sys.stdout.write(f'{one_line(line)}\n')


def complain(line: str) -> None:
    """The same on standard error."""
    sys.stderr.write(f'{one_line(line)}\n')


def format_bytes(count: float) -> str:
    """A size such as 434.9 MB."""
    for unit in ('B', 'kB', 'MB', 'GB'):
        if count < 1000:
            return f'{count:.0f} {unit}' if unit == 'B' else f'{count:.1f} {unit}'
        count /= 1000
    return f'{count:.1f} TB'


def format_duration(nanoseconds: int) -> str:
    """A duration such as 12.4 s or 7 min 30 s."""
    seconds = nanoseconds / 1e9
    if seconds < 120:
        return f'{seconds:.1f} s'
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes} min {rest} s'


def format_count(count: int, noun: str) -> str:
    """A count with its noun, such as 1 message or 2,104 messages."""
    return f'{count:,} {noun}{"" if count == 1 else "s"}'


def format_path(path: Path) -> str:
    """A path as the user would type it: relative where it is below the working folder."""
    try:
        return str(path.relative_to(Path.cwd()))
    except ValueError:
        return str(path)
