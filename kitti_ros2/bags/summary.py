# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What is in a bag at a glance, from the stamps of its messages."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

StampArray: TypeAlias = npt.NDArray[np.int64]
TopicKey: TypeAlias = tuple[str, str]
"""Topic name and message type."""


@dataclass
class BagIndex:
    """The stamps of a bag's messages, as its storage gives them.

    Attributes:
        stamps: Nanoseconds by topic and type, in any order, in as many pieces as there are.
        compressions: Names of the compressions met.
        complete: Whether the file ends as its format demands.
        warnings: What a user should know, one line each.
    """

    stamps: dict[TopicKey, list[StampArray]] = field(default_factory=dict)
    compressions: set[str] = field(default_factory=set)
    complete: bool = True
    warnings: list[str] = field(default_factory=list)

    def add(self, key: TopicKey, stamps: npt.ArrayLike) -> None:
        """Enter stamps (nanoseconds) of a topic; none at all makes the topic known."""
        self.stamps.setdefault(key, []).append(np.asarray(stamps, dtype=np.int64))

    def merge(self, other: BagIndex) -> None:
        """Take in the index of another file of the same bag."""
        for key, pieces in other.stamps.items():
            self.stamps.setdefault(key, []).extend(pieces)
        self.compressions |= other.compressions
        self.complete = self.complete and other.complete
        self.warnings += other.warnings

    def by_topic(self) -> dict[str, StampArray]:
        """By topic the stamps of its messages, (N,) nanoseconds, ascending."""
        found: dict[str, list[StampArray]] = {}
        for (topic, _), pieces in self.stamps.items():
            found.setdefault(topic, []).extend(pieces)
        return {topic: np.sort(np.concatenate(pieces)) for topic, pieces in found.items() if pieces}

    @property
    def total(self) -> int:
        """All messages."""
        return sum(len(piece) for pieces in self.stamps.values() for piece in pieces)


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag; what too few messages cannot tell is None.

    Attributes:
        name: Topic.
        msgtype: ROS 2 spelling of the type, such as sensor_msgs/msg/Imu.
        count: Messages.
        start_ns, end_ns: First and last stamp.
        median_period_ns: Median distance of neighbouring stamps.
        largest_gap_ns: Greatest distance of neighbouring stamps.
        largest_gap_at_ns: The stamp after which it comes.
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
    """What a bag holds.

    Attributes:
        container: mcap, rosbag2 mcap, rosbag2 sqlite3, sqlite3 or ros1.
        files: The files with messages, in order.
        size_bytes: Size of those files together.
        start_ns, end_ns: First and last stamp, None without messages.
        topics: By name.
        compression: none, or the names of the compressions met.
        complete: False where a file was cut off or damaged; what could be read is counted.
        warnings: What a user should know, one line each.
    """

    container: str
    files: tuple[Path, ...]
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    topics: tuple[TopicSummary, ...]
    compression: str
    complete: bool
    warnings: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """All messages."""
        return sum(topic.count for topic in self.topics)


def summarize(container: str, files: tuple[Path, ...], index: BagIndex) -> BagSummary:
    """The summary of an index."""
    topics = _topics(index.stamps)
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
        warnings=tuple(index.warnings),
    )


def _topics(stamps: Mapping[TopicKey, list[StampArray]]) -> tuple[TopicSummary, ...]:
    return tuple(
        summarize_topic(*key, np.concatenate(pieces)) for key, pieces in sorted(stamps.items())
    )


def summarize_topic(name: str, msgtype: str, stamps: StampArray) -> TopicSummary:
    """Count, times, rate and largest gap of one series; stamps in ns, in any order."""
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
