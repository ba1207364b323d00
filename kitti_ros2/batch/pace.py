# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How much of a collection is done, and how fast it goes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .manifest import DONE, FAILED, RUNNING, TODO

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .manifest import CollectionRun, UnitRecord


@dataclass(frozen=True)
class Pace:
    """How much is done, and how fast.

    Attributes:
        states: Number of units by state, each of STATES.
        lossy: Units that are done, with some data skipped.
        bad: Samples and files that were skipped.
        frames, messages, bytes: Sums over the units that are done.
        unit_seconds: Sum of the times of the units, however many ran at a time.
        recent: Units that the last run has ended.
        recent_seconds: From the start of the last run to the end of its last unit.
        recent_bytes: What they have written.
        seconds_left: Estimate for the units that are left; None without a measured one.
    """

    states: dict[str, int]
    lossy: int
    bad: int
    frames: int
    messages: int
    bytes: int
    unit_seconds: float
    recent: int
    recent_seconds: float
    recent_bytes: int
    seconds_left: float | None

    @property
    def left(self) -> int:
        """Number of units that are neither done nor failed."""
        return self.states[TODO] + self.states[RUNNING]


def measure_pace(records: Sequence[UnitRecord], run: CollectionRun | None) -> Pace:
    """Summarize the units of a manifest and its last run."""
    states = dict.fromkeys((TODO, RUNNING, DONE, FAILED), 0)
    states.update(Counter(each.state for each in records))
    totals: Counter[str] = Counter()
    for each in records:
        totals.update(each.counts)
    recent = [each for each in records if run and each.run == run.number and each.ended]
    ends = [each.ended for each in recent if each.ended is not None]
    # A clock that was set back gives no rate.
    seconds = max(0.0, max(ends) - run.started) if run and ends else 0.0
    left = states[TODO] + states[RUNNING]
    return Pace(
        states=states,
        lossy=sum(each.state == DONE and each.bad > 0 for each in records),
        bad=totals_bad(records),
        frames=totals['frames'],
        messages=totals['messages'],
        bytes=totals['bytes'],
        unit_seconds=sum(each.seconds for each in records),
        recent=len(recent),
        recent_seconds=seconds,
        recent_bytes=sum(each.counts.get('bytes', 0) for each in recent),
        seconds_left=left * seconds / len(recent) if recent and seconds else None,
    )


def totals_bad(records: Sequence[UnitRecord]) -> int:
    """Return the number of samples and files that were skipped."""
    return sum(each.bad for each in records)
