# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a process uses, sampled over time, and the figures that are made of it."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

SETTLED_S = 300.0
"""Until then caches fill: the slope is that of what follows."""

_PER_S = 600.0


@dataclass(frozen=True)
class Sample:
    """A process at a moment."""

    seconds: float
    rss_bytes: int
    files: int
    threads: int


def sample(pid: int, seconds: float) -> Sample:
    """What a process uses now."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii', errors='replace')
    values = dict(re.findall(r'^(VmRSS|Threads):\s+(\d+)', status, re.MULTILINE))
    files = len(os.listdir(f'/proc/{pid}/fd'))  # noqa: PTH208 - counts only
    return Sample(seconds, int(values['VmRSS']) << 10, files, int(values['Threads']))


def slope_mb_per_10_min(samples: list[Sample], after_s: float = SETTLED_S) -> float | None:
    """Growth of the memory in use after a time, by least squares; None without two samples."""
    late = [each for each in samples if each.seconds >= after_s]
    if len(late) < 2:
        return None
    times = np.array([each.seconds for each in late])
    sizes = np.array([each.rss_bytes for each in late]) / 1e6
    return float(np.polynomial.polynomial.polyfit(times, sizes, 1)[1]) * _PER_S


def in_10_000(part: int, whole: int) -> float:
    """A share, of ten thousand."""
    return 1e4 * part / whole if whole else 0.0
