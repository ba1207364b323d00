# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Quantities as people read them."""

from __future__ import annotations


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
