# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The synthetic GPS/IMU unit at 100 Hz, with the irregularities of KITTI's unsynchronised drives.

A packet is exact at its own time; its stamp is the time of its arrival, some microseconds off, and
seldom milliseconds late. Some packets are missing, and some come twice, with the same stamps; see
kitti/packet_stamps.py for those of KITTI.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..model.stamps import NS_PER_S

if TYPE_CHECKING:
    from ..model.samples import Int64Array

PERIOD_NS = 10_000_000
BEFORE_AND_AFTER_NS = 500_000_000
"""How long the unsynchronised drive begins before the first frame, and ends after the last."""

_JITTER_NS = 20_000
_LATE_SHARE = 0.005
_LATE_NS = (1_000_000, 4_000_000)
_SECONDS_PER_GAP = 8.0
_MISSING = (2, 13)  # packets, excluding the upper end
_SECONDS_PER_REPEAT = 1.5
_REPEATED = 6  # packets, as in KITTI


class Arrivals(NamedTuple):
    """The packets in the order of arrival, which is that of their file numbers.

    Attributes:
        times_ns: (N,) int64, the moments at which they are exact.
        stamps_ns: (N,) int64.
    """

    times_ns: Int64Array
    stamps_ns: Int64Array


def list_arrivals(seed: int, first_ns: int, last_ns: int) -> Arrivals:
    """Return the packets of a drive between the stamps of its first and its last frame."""
    rng = np.random.default_rng([seed, 9])
    begin_ns = first_ns - BEFORE_AND_AFTER_NS
    count = (last_ns + BEFORE_AND_AFTER_NS - begin_ns) // PERIOD_NS + 1
    times_ns = begin_ns + np.arange(count, dtype=np.int64) * PERIOD_NS
    late = np.where(rng.random(count) < _LATE_SHARE, rng.uniform(*_LATE_NS, count), 0.0)
    stamps_ns = times_ns + np.rint(rng.normal(0.0, _JITTER_NS, count) + late).astype(np.int64)
    order = _order_of_arrival(rng, int(count))
    return Arrivals(times_ns[order], stamps_ns[order])


def _order_of_arrival(rng: np.random.Generator, count: int) -> Int64Array:
    """Return the packets that arrive, some of them twice; there is always a gap and a repeat."""
    seconds = count * PERIOD_NS / NS_PER_S
    kept = np.ones(count, np.bool_)
    for start in rng.integers(count // 3, count, max(1, int(seconds / _SECONDS_PER_GAP))):
        kept[start : start + int(rng.integers(*_MISSING))] = False
    arriving = np.flatnonzero(kept)
    repeats = max(1, int(seconds / _SECONDS_PER_REPEAT))
    ends = rng.integers(_REPEATED, len(arriving), repeats)
    pieces, begun = [], 0
    for end in np.unique(ends).tolist():
        pieces += [arriving[begun:end], arriving[end - _REPEATED : end]]
        begun = end
    return np.concatenate([*pieces, arriving[begun:]])
