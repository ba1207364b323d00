# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Summaries of bags from the stamps of their messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from pathlib import Path

StampArray: TypeAlias = npt.NDArray[np.int64]
TopicKey: TypeAlias = tuple[str, str]
"""Topic name and message type."""

LAST_NS = 2**63 - 1
"""The stamp of all later messages: readers count with int64, MCAP with uint64."""


@dataclass
class BagIndex:
    """The stamps of a bag's messages, as its container stores them.

    Attributes:
        stamps: Nanoseconds by topic and type, in any order, in any number of pieces.
        compressions: Names of the compressions found.
        complete: Whether no file is truncated or damaged.
        findings: Notes and losses, one line each.
    """

    stamps: dict[TopicKey, list[StampArray]] = field(default_factory=dict)
    compressions: set[str] = field(default_factory=set)
    complete: bool = True
    findings: list[str] = field(default_factory=list)

    def add(self, key: TopicKey, stamps: npt.ArrayLike) -> None:
        """Add stamps (nanoseconds) of a topic; no stamps add the topic alone."""
        found = np.asarray(stamps)
        if found.dtype.kind == 'u':
            found = np.minimum(found, np.uint64(LAST_NS))
        self.stamps.setdefault(key, []).append(found.astype(np.int64, copy=False))

    def merge(self, other: BagIndex) -> None:
        """Add the index of another file of the same bag."""
        for key, pieces in other.stamps.items():
            self.stamps.setdefault(key, []).extend(pieces)
        self.compressions |= other.compressions
        self.complete = self.complete and other.complete
        self.findings += other.findings

    def by_topic(self) -> dict[str, StampArray]:
        """Return by topic the stamps of its messages, (N,) nanoseconds, ascending."""
        found: dict[str, list[StampArray]] = {}
        for (topic, _), pieces in self.stamps.items():
            found.setdefault(topic, []).extend(pieces)
        return {topic: np.sort(np.concatenate(pieces)) for topic, pieces in found.items() if pieces}

    @property
    def total(self) -> int:
        """Number of all messages."""
        return sum(len(piece) for pieces in self.stamps.values() for piece in pieces)


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag; values that need more messages than there are, are None.

    Attributes:
        name: Topic.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        count: Messages.
        start_ns, end_ns: First and last stamp.
        median_period_ns: Median difference of consecutive stamps.
        largest_gap_ns: Greatest difference of consecutive stamps.
        largest_gap_at_ns: The stamp at the start of that gap.
        mean_rate_hz: Messages per second between the first and the last.
    """

    name: str
    msgtype: str
    count: int
    start_ns: int | None = None
    end_ns: int | None = None
    median_period_ns: int | None = None
    largest_gap_ns: int | None = None
    largest_gap_at_ns: int | None = None
    mean_rate_hz: float | None = None


@dataclass(frozen=True)
class BagSummary:
    """The contents of a bag.

    Attributes:
        container: mcap, rosbag2 mcap, rosbag2 sqlite3, sqlite3 or ros1.
        files: The files with messages, in order.
        size_bytes: Size of those files together.
        start_ns, end_ns: First and last stamp, None without messages.
        topics: By name.
        compression: none, or the names of the compressions found.
        complete: False if a file is truncated or damaged; readable messages are counted.
        findings: Notes and losses, one line each.
    """

    container: str
    files: tuple[Path, ...]
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    topics: tuple[TopicSummary, ...]
    compression: str
    complete: bool
    findings: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Number of all messages."""
        return sum(topic.count for topic in self.topics)


def summarize(container: str, files: tuple[Path, ...], index: BagIndex) -> BagSummary:
    """Summarize an index."""
    topics = tuple(
        summarize_topic(*key, np.concatenate(pieces))
        for key, pieces in sorted(index.stamps.items())
    )
    starts = [topic.start_ns for topic in topics if topic.start_ns is not None]
    ends = [topic.end_ns for topic in topics if topic.end_ns is not None]
    return BagSummary(
        container=container,
        files=files,
        size_bytes=sum(path.stat().st_size for path in files),
        start_ns=min(starts, default=None),
        end_ns=max(ends, default=None),
        topics=topics,
        compression=', '.join(sorted(index.compressions - {'none', ''})) or 'none',
        complete=index.complete,
        findings=tuple(index.findings),
    )


def summarize_topic(name: str, msgtype: str, stamps: StampArray) -> TopicSummary:
    """Return count, times, rate and largest gap of one topic; stamps in ns, in any order."""
    if not len(stamps):
        return TopicSummary(name, msgtype, 0)
    stamps = np.sort(stamps)
    start_ns, end_ns = int(stamps[0]), int(stamps[-1])
    if len(stamps) == 1:
        return TopicSummary(name, msgtype, 1, start_ns, end_ns)
    gaps = np.diff(stamps)
    widest = int(gaps.argmax())
    return TopicSummary(
        name,
        msgtype,
        len(stamps),
        start_ns,
        end_ns,
        median_period_ns=int(np.median(gaps)),
        largest_gap_ns=int(gaps[widest]),
        largest_gap_at_ns=int(stamps[widest]),
        mean_rate_hz=len(gaps) * 1e9 / (end_ns - start_ns) if end_ns > start_ns else None,
    )
