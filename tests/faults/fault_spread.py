# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calls spread over a run."""

from __future__ import annotations


def spread(calls: int, most: int | None) -> list[int]:
    """Return numbers of calls, from 1; all if most is None, else about so many, evenly spread."""
    if most is None or calls <= most:
        return [*range(1, calls + 1)]
    return sorted({1 + index * (calls - 1) // (most - 1) for index in range(most)})
