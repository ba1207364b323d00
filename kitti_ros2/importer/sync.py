# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Assignment of samples to frames, and groups of messages, by their stamps alone."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..model.streams import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from ..model.samples import Int64Array


# Assignment of the samples of each stream to frames, by their stamps alone.


_Key = TypeVar('_Key')

NONE = -1
_LONE_PERIOD_NS = 100_000_000


@dataclass(frozen=True, eq=False)
class StreamMatch:
    """The assignment of the samples of a stream to frames.

    Attributes:
        indices: (N,) int64, for each frame the index of its sample, NONE where it has none.
        dropped: Number of samples without a frame.
        max_error_ns: Largest distance between a frame and its sample; 0 without matches.
        mean_error_ns: Their mean.
    """

    indices: Int64Array
    dropped: int
    max_error_ns: int
    mean_error_ns: float

    @property
    def matched(self) -> int:
        """Number of frames with a sample."""
        return int(np.count_nonzero(self.indices != NONE))


def match_frames(
    reference_ns: Int64Array, streams: Mapping[_Key, Int64Array], tolerance_ns: int
) -> dict[_Key, StreamMatch]:
    """Assign the nearest sample of each stream to each frame.

    Pairs are made in order of increasing distance: each sample goes to one frame at most, a pair is
    never further apart than the tolerance, and pairs do not cross, so samples stay in their order.
    Where two frames compete for a sample, the nearer one gets it (of two equally near ones the
    earlier); the other gets the sample on its other side, or none.

    Args:
        reference_ns: (N,) stamps of the frames, nanoseconds, in any order.
        streams: (M,) stamps of each stream, in any order.
        tolerance_ns: Nanoseconds, inclusive.
    """
    reference = np.asarray(reference_ns, dtype=np.int64)
    return {
        name: _match(reference, np.asarray(stamps_ns, dtype=np.int64), tolerance_ns)
        for name, stamps_ns in streams.items()
    }


def default_tolerance_ns(reference_ns: Int64Array) -> int:
    """Return half the median period of the frames, nanoseconds; of a single frame that of 10 Hz."""
    periods = np.diff(np.unique(reference_ns))
    return int(np.median(periods)) // 2 if len(periods) else _LONE_PERIOD_NS // 2


def usable_stamps(header_ns: Int64Array, log_ns: Int64Array) -> tuple[Int64Array, str | None]:
    """Select the stamps to use: header stamps, or log times where those are invalid.

    Args:
        header_ns: (N,) nanoseconds, in the order of the log.
        log_ns: (N,) nanoseconds.

    Returns:
        The stamps, and the reason for log times: most header stamps are 0, one is before 1970, or
        more than a second earlier than one before; None for header stamps. Of these, those that are
        not set get the median distance that the others have from log times.
    """
    unset = unset_stamps(header_ns)
    if 0 < 2 * np.count_nonzero(unset) < len(header_ns):
        lead_ns = np.sort((header_ns - log_ns)[~unset])
        header_ns = np.where(unset, log_ns + lead_ns[len(lead_ns) // 2], header_ns)
        unset[:] = False
    for is_wrong, fault in (
        (unset, '0'),
        (header_ns < 0, 'before 1970'),
        (late_ns(header_ns) > NS_PER_S, 'more than a second earlier than one before'),
    ):
        wrong = np.flatnonzero(is_wrong)
        if len(wrong):
            verb = 'is' if len(wrong) == 1 else 'are'
            return log_ns, (
                f'{len(wrong)} of {len(header_ns)} header stamps {verb} {fault}'
                f' (the first that of message {wrong[0] + 1}); log time is used'
            )
    return header_ns, None


def unset_stamps(stamps_ns: Int64Array) -> npt.NDArray[np.bool_]:
    """Return (N,) which stamps are not set: 0.

    The first may be 0 if the next one follows within a second: the time of simulators begins there.
    """
    unset: npt.NDArray[np.bool_] = stamps_ns == 0
    if len(stamps_ns) > 1 and 0 < stamps_ns[1] <= NS_PER_S:
        unset[0] = False
    return unset


def late_ns(stamps_ns: Int64Array) -> Int64Array:
    """Return (N,) the nanoseconds by which stamps are earlier than the latest one before them."""
    latest: Int64Array = np.maximum.accumulate(stamps_ns)
    return latest - stamps_ns


def _match(reference_ns: Int64Array, stamps_ns: Int64Array, tolerance_ns: int) -> StreamMatch:
    """Match one stream.

    In the merged order of frames and samples, the nearest pair always consists of neighbours, and
    once it is made no pair crosses it. So all pairs are chosen among neighbours alone.
    """
    count = len(reference_ns)
    stamps = np.concatenate([reference_ns, stamps_ns])
    # Equal stamps alternate, beginning with a frame.
    order = np.lexsort((np.concatenate([_turns(reference_ns), _turns(stamps_ns)]), stamps))
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


def _turns(stamps_ns: Int64Array) -> npt.NDArray[np.intp]:
    """Return for each stamp the number of equal stamps before it."""
    order = np.argsort(stamps_ns, kind='stable')
    ordered = stamps_ns[order]
    turns = np.empty(len(order), dtype=np.intp)
    turns[order] = np.arange(len(order)) - np.searchsorted(ordered, ordered)
    return turns


def _nearest_first(places: npt.NDArray[np.intp], gaps: Int64Array) -> npt.NDArray[np.bool_]:
    """Select pairs in order of increasing gap, each of which excludes its neighbours.

    Pairs at consecutive places share a frame or a sample. A pair is made unless a nearer neighbour
    is made: along a slope of increasing gaps, from its lowest pair up, every other one; the pair on
    top of two slopes, if both leave it free.

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
    """Return for each the length of the run, including it, of values above the one before."""
    position = np.arange(len(above))
    return position - np.maximum.accumulate(np.where(above, 0, position))


# The messages of a topic of labels that belong together: those of one stamp.
#
# Some publishers send the boxes of a moment in several arrays, one a class; several detectors may
# share a topic. A MarkerArray has no stamp of its own, its markers have; one without markers
# belongs to the nearest others.


def group_messages(stamps_ns: Sequence[int], log_ns: Sequence[int]) -> list[list[int]]:
    """Group messages by stamp; each is alone unless another one has its stamp.

    Args:
        stamps_ns: Of each; 0 for an array of markers without one, negative for no stamp.
        log_ns: Of each, in the order of reading.

    Returns:
        The places of each group's messages, groups in the order of their first ones.
    """
    stamps = np.array(stamps_ns, dtype=np.int64)
    alone = [[place] for place in range(len(stamps))]
    known = np.unique(stamps[stamps > 0])
    # A publisher that never renews its stamp tells nothing by it.
    if len(known) < 2 or len(known) == np.count_nonzero(stamps > 0):
        return alone
    logs = np.array(log_ns, dtype=np.int64)
    starts = np.full(len(known), np.iinfo(np.int64).max)
    np.minimum.at(starts, np.searchsorted(known, stamps[stamps > 0]), logs[stamps > 0])
    near_ns = int(np.median(np.diff(np.sort(starts)))) // 2
    groups: dict[int, list[int]] = defaultdict(list)
    for place, stamp in enumerate(stamps.tolist()):
        key = stamp if stamp > 0 else -1 - place
        if not stamp:
            gaps = np.where(stamps > 0, np.abs(logs - logs[place]), np.iinfo(np.int64).max)
            nearest = int(np.argmin(gaps))
            key = int(stamps[nearest]) if gaps[nearest] <= near_ns else -1 - place
        groups[key].append(place)
    return sorted(groups.values())


def places_of(
    indices: Int64Array, groups: Sequence[Sequence[int]] | None
) -> tuple[tuple[int, ...], ...]:
    """Return the places of the messages of each frame, by the index of its group."""
    return tuple(
        () if index == NONE else (index,) if groups is None else tuple(groups[index])
        for index in indices.tolist()
    )


def first_places(groups: Sequence[Sequence[int]] | None, indices: Int64Array) -> Int64Array:
    """Return the place of the first message of each frame's group, NONE without one."""
    if groups is None:
        return indices
    firsts = np.array([*(group[0] for group in groups), NONE], dtype=np.int64)
    return np.asarray(firsts[indices])


def by_group(stamps_ns: Int64Array, groups: Sequence[Sequence[int]] | None) -> Int64Array:
    """Return the stamp of the first message of each group."""
    return stamps_ns if groups is None else np.asarray(stamps_ns[[group[0] for group in groups]])
