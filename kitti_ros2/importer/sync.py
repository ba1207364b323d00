# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which sample of each stream belongs to which frame, by their stamps alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from ..model.samples import Int64Array

NONE = -1
_LONE_PERIOD_NS = 100_000_000


@dataclass(frozen=True, eq=False)
class StreamMatch:
    """How a stream's samples went to the frames.

    Attributes:
        indices: (N,) int64, for each frame the index of its sample, NONE where it has none.
        dropped: Samples that no frame took.
        max_error_ns: Largest distance between a frame and its sample; 0 without matches.
        mean_error_ns: Their mean.
    """

    indices: Int64Array
    dropped: int
    max_error_ns: int
    mean_error_ns: float

    @property
    def matched(self) -> int:
        """Frames that have a sample."""
        return int(np.count_nonzero(self.indices != NONE))

    @property
    def unmatched(self) -> int:
        """Frames that have none."""
        return len(self.indices) - self.matched


def match_frames(
    reference_ns: Int64Array, streams: Mapping[str, Int64Array], tolerance_ns: int
) -> dict[str, StreamMatch]:
    """The nearest sample of each stream for each frame.

    Pairs are made from the nearest on: each sample goes to one frame at most, a pair is never
    further apart than the tolerance, and pairs do not cross, so samples stay in their order. Where
    two frames want one sample, the nearer has it, the earlier of two equally near ones; the other
    takes the sample on its other side, or none.

    Args:
        reference_ns: (N,) stamps of the frames, nanoseconds, in any order.
        streams: (M,) stamps of each stream, by its name, in any order.
        tolerance_ns: Nanoseconds, itself allowed.
    """
    reference = np.asarray(reference_ns, dtype=np.int64)
    return {
        name: _match(reference, np.asarray(stamps_ns, dtype=np.int64), tolerance_ns)
        for name, stamps_ns in streams.items()
    }


def default_tolerance_ns(reference_ns: Int64Array) -> int:
    """Half the median period of the frames, nanoseconds; that of 10 Hz where there is no period."""
    periods = np.diff(np.unique(reference_ns))
    return int(np.median(periods)) // 2 if len(periods) else _LONE_PERIOD_NS // 2


def usable_stamps(header_ns: Int64Array, log_ns: Int64Array) -> tuple[Int64Array, str | None]:
    """The stamps to go by: header stamps, or log times where those cannot be right.

    Args:
        header_ns: (N,) nanoseconds, in the order of the log.
        log_ns: (N,) nanoseconds.

    Returns:
        The stamps, and why they are not the header's: some are 0, before 1970, or earlier than the
        one before.
    """
    zeros = np.flatnonzero(header_ns == 0)
    if len(zeros):
        return log_ns, _reason(zeros, len(header_ns), '0')
    negative = np.flatnonzero(header_ns < 0)
    if len(negative):
        return log_ns, _reason(negative, len(header_ns), 'before 1970')
    backwards = np.flatnonzero(np.diff(header_ns) < 0) + 1
    if len(backwards):
        return log_ns, _reason(backwards, len(header_ns), 'earlier than the one before')
    return header_ns, None


def _reason(wrong: npt.NDArray[np.intp], count: int, fault: str) -> str:
    verb = 'is' if len(wrong) == 1 else 'are'
    return (
        f'{len(wrong)} of {count} header stamps {verb} {fault}'
        f' (the first that of message {wrong[0] + 1}); log time is used'
    )


def _match(reference_ns: Int64Array, stamps_ns: Int64Array, tolerance_ns: int) -> StreamMatch:
    """Match one stream.

    In the merged order of frames and samples, the nearest pair is always one of neighbours, and
    once it is made nothing pairs across it. So the pairs from the nearest on are a choice among
    neighbours alone.
    """
    count = len(reference_ns)
    stamps = np.concatenate([reference_ns, stamps_ns])
    order = _merged_order(reference_ns, stamps_ns, stamps)
    gaps = np.diff(stamps[order])
    is_frame = order < count
    possible = (is_frame[1:] != is_frame[:-1]) & (gaps <= tolerance_ns)
    left = np.flatnonzero(possible)
    left = left[_nearest_first(left, gaps[left])]
    pairs = np.stack([order[left], order[left + 1]])
    frames, samples = pairs.min(axis=0), pairs.max(axis=0) - count
    indices = np.full(count, NONE, dtype=np.int64)
    indices[frames] = samples
    errors = gaps[left]
    return StreamMatch(
        indices,
        dropped=len(stamps_ns) - len(samples),
        max_error_ns=int(errors.max(initial=0)),
        mean_error_ns=float(errors.mean()) if len(errors) else 0.0,
    )


def _merged_order(
    reference_ns: Int64Array, stamps_ns: Int64Array, stamps: Int64Array
) -> npt.NDArray[np.intp]:
    """The order in time of both; of equal stamps the first frame, the first sample, and so on."""
    turns = np.concatenate([_turns(reference_ns), _turns(stamps_ns)])
    return np.lexsort((turns, stamps))


def _turns(stamps_ns: Int64Array) -> npt.NDArray[np.intp]:
    """How many equal stamps stand before each."""
    order = np.argsort(stamps_ns, kind='stable')
    ordered = stamps_ns[order]
    turns = np.empty(len(order), dtype=np.intp)
    turns[order] = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    return turns


def _nearest_first(places: npt.NDArray[np.intp], gaps: Int64Array) -> npt.NDArray[np.bool_]:
    """Which of the possible pairs are made when the nearest goes first and excludes its neighbours.

    Pairs at consecutive places share a frame or a sample. A pair is made unless a nearer neighbour
    is: along a slope of ever larger gaps, from its lowest pair up, every other one; the pair on top
    of two slopes, if both leave it free.

    Args:
        places: (K,) ascending.
        gaps: (K,) nanoseconds.
    """
    adjoining = np.diff(places, prepend=-2) == 1
    change = np.diff(gaps, prepend=gaps[:1])
    above_the_last = adjoining & (change >= 0)
    above_the_next = np.roll(adjoining & (change < 0), -1)
    free_before = _steps_up(above_the_last) % 2 == 0
    free_after = _steps_up(above_the_next[::-1])[::-1] % 2 == 0
    made: npt.NDArray[np.bool_] = free_before & free_after
    return made


def _steps_up(above: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """How many in a row, up to and with each, are above the one before."""
    position = np.arange(len(above))
    return position - np.maximum.accumulate(np.where(above, 0, position))
