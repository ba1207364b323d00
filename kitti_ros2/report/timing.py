# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How evenly a stream comes, and whether its numbers mean the same moments as another's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..model.recording import StreamIndex
    from ..model.samples import Int64Array

GAP_PERIODS = 1.5
"""A distance of so many periods is a gap: one sample lost makes it 2."""

_EVEN = 0.25
_MOSTLY = 0.6
_FEWEST = 3


@dataclass(frozen=True)
class Gap:
    """A place where samples are lacking.

    Attributes:
        at_ns: The stamp after which it comes.
        length_ns: To the next stamp.
        lacking: How many samples would have been there at the usual period.
    """

    at_ns: int
    length_ns: int
    lacking: int


@dataclass(frozen=True, eq=False)
class Timing:
    """How evenly the samples of a stream come.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        period_ns: Median distance of neighbours, None with less than two.
        rate_hz: Samples per second between the first and the last; None where that is no time.
        jitter_ns: 95 of 100 distances differ from the median by no more, gaps left out; None with
            less than three.
        regular: Whether most distances are near the median, so that gaps mean something.
        gaps: In order of time; none unless regular.
        repeated: Stamps that equal one before them.
        backward: Samples stamped earlier than the one before them.
    """

    stamps_ns: Int64Array
    period_ns: int | None = None
    rate_hz: float | None = None
    jitter_ns: int | None = None
    regular: bool = False
    gaps: tuple[Gap, ...] = ()
    repeated: int = 0
    backward: int = 0

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def intervals_ns(self) -> Int64Array:
        """(N-1,) distances of neighbours, nanoseconds."""
        distances: Int64Array = np.diff(self.stamps_ns)
        return distances


def timing_of(stamps_ns: Int64Array) -> Timing:
    """The timing of (N,) stamps in the order of the samples."""
    backward = int(np.count_nonzero(np.diff(stamps_ns) < 0))
    stamps = np.sort(stamps_ns)
    distances = np.diff(stamps)
    if not len(distances):
        return Timing(stamps)
    period = int(np.median(distances))
    span = int(stamps[-1] - stamps[0])
    near = np.abs(distances - period) <= _EVEN * period
    regular = len(distances) >= _FEWEST and period > 0 and bool(near.mean() >= _MOSTLY)
    wide = distances > GAP_PERIODS * period if regular else np.zeros(len(distances), np.bool_)
    return Timing(
        stamps,
        period_ns=period,
        rate_hz=len(distances) * 1e9 / span if span else None,
        jitter_ns=_jitter(distances[~wide], period),
        regular=regular,
        gaps=tuple(
            Gap(int(stamps[index]), int(distances[index]), round(distances[index] / period) - 1)
            for index in np.flatnonzero(wide).tolist()
        ),
        repeated=int(np.count_nonzero(distances == 0)),
        backward=backward,
    )


def _jitter(distances: Int64Array, period: int) -> int | None:
    if len(distances) < 2:
        return None
    return int(np.percentile(np.abs(distances - period), 95))


@dataclass(frozen=True)
class Pairing:
    """How the samples of a stream lie to those of another that have the same file number.

    Attributes:
        pairs: How many have the same number.
        numbers: Those nearer to a sample of the other stream with another number.
    """

    pairs: int
    numbers: tuple[int, ...]


def pairing_of(stream: StreamIndex, reference: StreamIndex) -> Pairing | None:
    """The pairing of a stream with a reference by file number; None where no number is common.

    A sample is nearer to another frame where it is more than half a period of the reference from
    its own: files renumbered without their stamps show so.
    """
    common, mine, theirs = np.intersect1d(
        stream.numbers, reference.numbers, assume_unique=True, return_indices=True
    )
    if not len(common):
        return None
    offsets = stream.stamps_ns[mine] - reference.stamps_ns[theirs]
    period = timing_of(reference.stamps_ns).period_ns
    shifted = np.abs(offsets) > period / 2 if period else np.zeros(len(common), np.bool_)
    return Pairing(len(common), tuple(common[shifted].tolist()))
