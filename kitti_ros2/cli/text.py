# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: lines for a terminal, losses, readable paths and quantities."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..model.text import format_bytes, format_count, format_duration, one_line

if TYPE_CHECKING:
    from ..model.losses import Loss

_SHOWN_LOSSES = 20


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
    except (ValueError, OSError):  # elsewhere; or the working directory was deleted
        return str(path)


def show_losses(losses: tuple[Loss, ...]) -> None:
    """Print skipped data with its count on standard error, one line per cause."""
    if not losses:
        return
    causes: dict[str, list[Loss]] = {}
    for loss in losses:
        causes.setdefault(loss.text(), []).append(loss)
    for message, same in list(causes.items())[:_SHOWN_LOSSES]:
        count = sum(loss.count for loss in same)
        names = same[0].stream + (f' and {len(same) - 1} more' if len(same) > 1 else '')
        complain(f'skipped {names} ({count}): {message}')
    rest = list(causes.values())[_SHOWN_LOSSES:]
    if rest:
        count = sum(loss.count for same in rest for loss in same)
        complain(f'skipped {count} more, for {len(rest)} more reasons')
    total = sum(loss.count for loss in losses)
    listed = 'the first of them listed above' if rest else 'listed above'
    complain(f'kitti-ros2: {total} skipped in all, {listed}; exit code 1')
