# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps of the packets of an unsynchronised drive: repeats, gaps, and evenly spaced stamps.

The unit sends 100 packets a second; a packet is stamped when it arrives. Irregular in KITTI:

- Packets that come twice, with the stamps of the first time: in 2011_09_26_drive_0028_extract the
  stamps step back by 0.05 s at 28 places, after which the last 6 packets are repeated
  (www.cnblogs.com/goodknight/p/7426221.html).
- Missing packets and jitter: in 2011_10_03_drive_0027 half of the intervals are within 9.967 and
  10.025 ms, the longest is 0.52 s (github.com/AlexGeControl/Sensor-Fusion, issue 1).

A stamp that does not increase stops others: gtsam throws at dt <= 0 (014b419,
gtsam/navigation/ImuFactor.cpp, integrateMeasurement), which ends LIO-SAM; FAST-LIO2 clears its
buffer at a step back (src/laserMapping.cpp, imu_cbk).

LIO-SAM's own converter fits one line to all stamps by their position in the listing
(config/doc/kitti2bag/kitti2bag.py, save_imu_data_raw), which shifts every packet after a gap or a
repeat. Here each run of packets without a gap has its own offset, and all have the same period.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from ..model.geometry import Float64Array
    from ..model.samples import Int64Array

_REPEATED_WITHIN = 100  # packets: a second
_GAP_PERIODS = 1.5


@dataclass(frozen=True, eq=False)
class PacketOrder:
    """The order of packets in time.

    Attributes:
        kept: (N,) positions in the listing, in order of time, each with a later stamp.
        repeats: Positions of packets that repeat one shortly before, and of
        clashes: those that have the stamp of another one, but other values.
        late: How many of the kept ones are listed after one of a later stamp.
    """

    kept: Int64Array
    repeats: tuple[int, ...]
    clashes: tuple[int, ...]
    late: int


@dataclass(frozen=True, eq=False)
class PacketLine:
    """Least squares of stamp over packet number: one period, and an offset for each run.

    Attributes:
        stamps_ns: (N,) int64, the fitted stamps, increasing.
        starts: Position of the first packet of each run.
        period_ns: Nanoseconds from packet to packet in a run.
        missing: Number of packets missing before each run but the first.
        residuals_ns: (N,) original minus fitted stamps.
    """

    stamps_ns: Int64Array
    starts: Int64Array
    period_ns: float
    missing: Int64Array
    residuals_ns: Int64Array


def order_packets(stamps_ns: Int64Array, text_of: Callable[[int], str | None]) -> PacketOrder:
    """Bring packets in order of time, without repeats.

    Args:
        stamps_ns: (N,) in the order of the listing.
        text_of: Returns the text of the packet at a position, None if it cannot be read; called
            only near steps back.
    """
    highest = np.maximum.accumulate(stamps_ns)
    late = [int(at) + 1 for at in np.flatnonzero(stamps_ns[1:] <= highest[:-1])]
    repeats = _find_repeats(late, text_of)
    rest = np.delete(np.arange(len(stamps_ns)), repeats)
    rest = rest[np.argsort(stamps_ns[rest], kind='stable')]
    again = np.flatnonzero(np.diff(stamps_ns[rest]) == 0) + 1
    clashes = sorted(rest[again].tolist())
    return PacketOrder(
        kept=np.delete(rest, again),
        repeats=tuple(repeats),
        clashes=tuple(clashes),
        late=len({*late} - {*repeats} - {*clashes}),
    )


def _find_repeats(late: Sequence[int], text_of: Callable[[int], str | None]) -> list[int]:
    """Return the positions, of those given, of packets that one of the last second equals."""
    near = {at for each in late for at in range(max(0, each - _REPEATED_WITHIN), each + 1)}
    suspects, found = {*late}, []
    last: dict[str, int] = {}
    for at in sorted(near):
        text = text_of(at)
        if text is None:
            continue
        if at in suspects and text in last and at - last[text] <= _REPEATED_WITHIN:
            found.append(at)
        last[text] = at
    return found


def fit_line(stamps_ns: Int64Array) -> PacketLine:
    """Fit evenly spaced stamps to increasing ones.

    Runs are divided where an interval is above 1.5 median intervals; those between which less than
    1.5 periods remain after the fit are joined, since their packets came late, but none is missing.

    Args:
        stamps_ns: (N,) int64, increasing, N > 0.
    """
    if len(stamps_ns) == 1:
        none = np.zeros(0, np.int64)
        return PacketLine(stamps_ns, np.zeros(1, np.int64), 0.0, none, np.zeros(1, np.int64))
    intervals = np.diff(stamps_ns)
    starts = np.flatnonzero(np.r_[True, intervals > _GAP_PERIODS * np.median(intervals)])
    while True:
        fitted, period = _fit_runs(stamps_ns, starts)
        gaps = (fitted[starts[1:]] - fitted[starts[1:] - 1]) / period
        divided = np.r_[True, gaps >= _GAP_PERIODS]
        if divided.all():
            missing = np.rint(gaps).astype(np.int64) - 1
            return PacketLine(fitted, starts, period, missing, stamps_ns - fitted)
        starts = starts[divided]


def _fit_runs(stamps_ns: Int64Array, starts: Int64Array) -> tuple[Int64Array, float]:
    """Return fitted stamps and the common period of runs, of which one has two packets or more."""
    counts = np.diff(np.r_[starts, len(stamps_ns)])
    run = np.repeat(np.arange(len(starts)), counts)
    numbers = np.arange(len(stamps_ns)) - starts[run]
    origins = stamps_ns[starts]
    times = (stamps_ns - origins[run]).astype(np.float64)
    middle = (counts - 1) / 2
    mean = np.add.reduceat(times, starts) / counts
    steps: Float64Array = numbers - middle[run]
    period = float(steps @ (times - mean[run]) / (steps @ steps))
    offsets = np.floor(mean[run] + period * steps + 0.5).astype(np.int64)
    return origins[run] + offsets, period


def gaps_over(
    stamps_ns: Int64Array, begin_ns: Int64Array, end_ns: Int64Array, longest_ns: float
) -> npt.NDArray[np.bool_]:
    """Return (M,) bool: whether packets are missing within each span of time.

    Args:
        stamps_ns: (N,) of the packets, increasing, N > 0.
        begin_ns: (M,) of the spans.
        end_ns: The same.
        longest_ns: The longest interval between packets that is no gap.
    """
    outside = (begin_ns < stamps_ns[0]) | (end_ns > stamps_ns[-1])
    wide = np.diff(stamps_ns) > longest_ns
    before = np.r_[0, np.cumsum(wide)]  # gaps before each packet
    first = np.clip(np.searchsorted(stamps_ns, begin_ns, 'right') - 1, 0, None)
    last = np.clip(np.searchsorted(stamps_ns, end_ns, 'left'), None, len(stamps_ns) - 1)
    crossed: npt.NDArray[np.bool_] = outside | (before[last] > before[first])
    return crossed
