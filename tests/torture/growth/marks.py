# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Marks of costs that are too high."""

FASTER = 3.0
"""Times the cost for twice the input, where 2 is right, and clocks are noisy."""
SEEN_S = 0.5
"""Below it the difference is noise."""

MOST_GROWTH_MB = 20.0
"""Above it memory grows with the number of frames."""


def judge_peaks(first_mb: float, second_mb: float) -> str:
    """Return * if a command takes more memory on more frames."""
    return '*' * (second_mb - first_mb > MOST_GROWTH_MB)


def judge(first_s: float, second_s: float, size: int) -> str:
    """Mark what N, and 2 N with so many bytes, cost above none.

    Args:
        first_s, second_s: CPU time for N and for 2 N.
        size: Bytes of the input with 2 N.

    Returns:
        * if it grows faster than N, ! if it is above 1 s + n / (1 MB/s), or both.
    """
    grows = second_s - first_s > SEEN_S and second_s > FASTER * first_s
    return '*' * grows + '!' * (second_s > 1 + size / 1e6)
