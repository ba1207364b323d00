# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Report of skipped data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .text import complain

if TYPE_CHECKING:
    from ..model.losses import Loss

_SHOWN_LOSSES = 20


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
