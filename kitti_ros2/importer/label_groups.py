# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of a topic of labels that belong together: those of one stamp.

Some publishers send the boxes of a moment in several arrays, one a class; several detectors may
share a topic. A MarkerArray has no stamp of its own, its markers have; one without markers belongs
to the nearest others.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from .sync import NONE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.samples import Int64Array


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
