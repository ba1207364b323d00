# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The nearest of known stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .samples import Int64Array


def nearest_stamps(known_ns: Int64Array, stamps_ns: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Return the place of the nearest of (N,) ascending stamps, and how much later (M,) are.

    Of two that are as near it is the earlier one.
    """
    after = np.minimum(np.searchsorted(known_ns, stamps_ns), len(known_ns) - 1)
    before = np.maximum(after - 1, 0)
    is_before = stamps_ns - known_ns[before] <= np.abs(known_ns[after] - stamps_ns)
    place = np.where(is_before, before, after)
    return place, stamps_ns - known_ns[place]
