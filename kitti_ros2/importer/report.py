# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What a conversion from a bag to KITTI did, and what it lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.losses import Loss
from .frames import frame_topics
from .survey import TF_TYPES

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping
    from pathlib import Path

    from ..model.streams import Layout
    from .plan import Plan
    from .survey import Survey, TopicSurvey


@dataclass(frozen=True)
class ImportReport:
    """What was written, and what was not.

    Attributes:
        path: The data set's folder.
        layout: Which of the four.
        name: Drive, sequence or split.
        counts: Files, or lines of a common file, by stream.
        frames: How many frames were written.
        size_bytes: Of all files with samples.
        losses: What was skipped.
        notes: What is worth a word and no loss.
    """

    path: Path
    layout: Layout
    name: str
    counts: Mapping[str, int]
    frames: int
    size_bytes: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


class LossTally:
    """Messages that could not be used, those of one topic and reason counted together."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._first_ns: dict[tuple[str, str], int] = {}

    def lose(self, topic: str, stamp_ns: int, reason: str) -> None:
        """Count one."""
        self._counts[topic, reason] += 1
        self._first_ns.setdefault((topic, reason), stamp_ns)

    def losses(self) -> tuple[Loss, ...]:
        """Each with the stamp of its first message."""
        return tuple(
            Loss(topic, count, f'{topic} at {self._first_ns[topic, reason]}: {reason}')
            for (topic, reason), count in self._counts.items()
        )


def damage(losses: Mapping[str, int | None], name: str) -> tuple[Loss, ...]:
    """What a bag lost, as far as it has been read; what is of unknown number counts once."""
    return tuple(Loss(name, count or 1, text) for text, count in losses.items())


def merged(*found: Mapping[str, int | None]) -> dict[str, int | None]:
    """What passes over different topics of a bag found damaged; None: an unknown count."""
    total: dict[str, int | None] = {}
    for losses in found:
        for text, count in losses.items():
            known = total.get(text, 0)
            total[text] = None if count is None or known is None else known + count
    return total


def unread(survey: Survey, plan: Plan, named: Collection[str]) -> tuple[Loss, ...]:
    """Messages of a plan's topics that the first pass could not decode.

    Args:
        survey: What that pass found.
        plan: Names topics; transforms are always among them.
        named: Topics whose messages are named one by one already.
    """
    wanted = {camera.info for camera in plan.cameras.values()} | set(frame_topics(plan).values())
    wanted |= {plan.imu, plan.fix, plan.velocity}
    if plan.pose is not None:
        wanted.add(plan.pose.topic)
    return tuple(
        undecoded(topic)
        for topic in survey.topics.values()
        if (topic.failures or topic.headless)
        and topic.name not in named
        and (topic.name in wanted or topic.msgtype in TF_TYPES)
    )


def undecoded(topic: TopicSurvey) -> Loss:
    """The messages of a topic that were tried and cannot be decoded, by the reason of the first."""
    every = '' if topic.is_readable else 'not one of its messages can be read; the first '
    count = max(topic.failures, len(topic.headless))
    reason = topic.failure or 'a header cannot be decoded'
    return Loss(topic.name, count, f'{topic.name}: {every}{reason}')
