# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a process uses, sampled over time, and the figures that are made of it."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

SETTLED_S = 300.0
"""Until then caches fill: the slope is that of what follows."""

_PER_S = 600.0


@dataclass(frozen=True)
class Sample:
    """A process at a moment.

    Attributes:
        seconds: The moment.
        rss_bytes: The memory in use, with what it shares: files, and segments of Fast DDS.
        private_bytes: What it shares with no other process.
        files: Open files.
        threads: Its threads.
    """

    seconds: float
    rss_bytes: int
    private_bytes: int
    files: int
    threads: int


def sample(pid: int, seconds: float) -> Sample:
    """What a process uses now."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii', errors='replace')
    values = dict(re.findall(r'^(VmRSS|RssAnon|Threads):\s+(\d+)', status, re.MULTILINE))
    files = len(os.listdir(f'/proc/{pid}/fd'))  # noqa: PTH208 - counts only
    sizes = (int(values[each]) << 10 for each in ('VmRSS', 'RssAnon'))
    return Sample(seconds, *sizes, files, int(values['Threads']))


def slope_mb_per_10_min(
    seconds: Sequence[float], sizes: Sequence[int], after_s: float = SETTLED_S
) -> float | None:
    """Growth of a size in bytes after a time, by least squares; None without two samples."""
    late = np.array(seconds) >= after_s
    if late.sum() < 2:
        return None
    times, found = np.array(seconds)[late], np.array(sizes)[late] / 1e6
    return float(np.polynomial.polynomial.polyfit(times, found, 1)[1]) * _PER_S


def in_10_000(part: int, whole: int) -> float:
    """A share, of ten thousand."""
    return 1e4 * part / whole if whole else 0.0
