# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which commands meet faults, and calls spread over their runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


def beginning_with(beginnings: list[str], names: Iterable[str]) -> list[str]:
    """Return the names that begin with one of some words; all without words."""
    return [name for name in names if not beginnings or name.startswith(tuple(beginnings))]


def spread(calls: int, most: int | None) -> list[int]:
    """Return numbers of calls, from 1; all if most is None, else about so many, evenly spread."""
    if most is None or calls <= most:
        return [*range(1, calls + 1)]
    return sorted({call_at(calls, (index + 0.5) / most) for index in range(most)})


def call_at(calls: int, part: float) -> int:
    """Return the number of the call after a part of a run, from 0 to 1."""
    return min(calls, 1 + int(calls * part))
