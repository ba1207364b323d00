# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rate, jitter and gaps of a stream, and whether its numbers match another stream's in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..model.recording import StreamIndex
    from ..model.samples import Int64Array

GAP_PERIODS = 1.5
"""A distance of more periods than this is a gap; one lost sample makes it 2."""

_EVEN = 0.25
_MOSTLY = 0.6
_FEWEST = 3


@dataclass(frozen=True)
class Gap:
    """A gap, where samples are missing.

    Attributes:
        at_ns: The stamp before it.
        length_ns: Distance to the next stamp.
        lacking: Number of missing samples, by the usual period.
    """

    at_ns: int
    length_ns: int
    lacking: int


@dataclass(frozen=True, eq=False)
class Timing:
    """The timing of the samples of a stream.

    Attributes:
        stamps_ns: (N,) int64, ascending.
        period_ns: Median distance of neighbours, None with less than two.
        rate_hz: Samples per second between the first and the last; None if they are equal.
        jitter_ns: 95th percentile of the deviation of distances from the median, without gaps; None
            with less than three stamps.
        regular: Whether most distances are near the median, so that gaps are meaningful.
        gaps: In order of time; none unless regular.
        repeated: Number of stamps equal to the one before.
        backward: Number of samples stamped earlier than the one before.
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
    """Compute the timing of (N,) stamps in the order of the samples."""
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


def shifted_numbers(stream: StreamIndex, reference: StreamIndex) -> tuple[list[int], int]:
    """Compare the samples of a stream with those of a reference with the same file number.

    Returns:
        The file numbers that are nearer to another sample of the reference, and the number of all
        common ones. A sample is nearer to another if it is more than half a period of the reference
        away from its own: this detects files renumbered without their stamps.
    """
    common, mine, theirs = np.intersect1d(
        stream.numbers, reference.numbers, assume_unique=True, return_indices=True
    )
    offsets = stream.stamps_ns[mine] - reference.stamps_ns[theirs]
    period = timing_of(reference.stamps_ns).period_ns
    shifted = common[np.abs(offsets) > period / 2] if period else []
    return [int(number) for number in shifted], len(common)
