# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The results and losses of a conversion from a bag to KITTI."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..model.losses import Loss
from ..model.msgtypes import TF_TYPES
from .frames import frame_topics

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from ..model.layouts import Layout
    from .plan import Plan
    from .survey import Survey
    from .topic_survey import TopicSurvey


@dataclass(frozen=True)
class ImportReport:
    """The result of a conversion.

    Attributes:
        layout: Which of the four.
        name: Drive, sequence or split.
        counts: Files, or lines of a common file, by stream.
        frames: Number of frames written.
        size_bytes: Of all files with samples.
        losses: What was skipped.
        notes: Non-fatal remarks.
    """

    layout: Layout
    name: str
    counts: Mapping[str, int]
    frames: int
    size_bytes: int
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


class LossTally:
    """Counts unusable messages by topic and reason."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._first_ns: dict[tuple[str, str], int] = {}

    def lose(self, topic: str, stamp_ns: int, reason: str) -> None:
        """Count a message."""
        self._counts[topic, reason] += 1
        self._first_ns.setdefault((topic, reason), stamp_ns)

    def losses(self) -> tuple[Loss, ...]:
        """Return the losses, each with the stamp of its first message."""
        return tuple(
            Loss(topic, count, f'{topic} at {self._first_ns[topic, reason]}: {reason}')
            for (topic, reason), count in self._counts.items()
        )


def damage(losses: Mapping[str, int | None], name: str) -> tuple[Loss, ...]:
    """Return the damage of a bag as losses; an unknown number of messages counts as one."""
    return tuple(Loss(name, count or 1, text) for text, count in losses.items())


def merged(*found: Mapping[str, int | None]) -> dict[str, int | None]:
    """Add up the damage that passes over different topics of a bag found; None: unknown count."""
    total: dict[str, int | None] = {}
    for losses in found:
        for text, count in losses.items():
            known = total.get(text, 0)
            total[text] = None if count is None or known is None else known + count
    return total


def unread(survey: Survey, plan: Plan, named: Collection[str]) -> tuple[Loss, ...]:
    """Return the messages of a plan's topics that the first pass could not decode.

    Args:
        survey: The result of that pass.
        plan: Names the topics; those of transforms are always included.
        named: Topics whose messages are reported one by one already.
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
    """Return the messages of a topic that failed to decode as a loss, with the first reason."""
    every = '' if topic.is_readable else 'not one of its messages can be read; the first '
    count = max(topic.failures, len(topic.headless))
    reason = topic.failure or 'a header cannot be decoded'
    return Loss(topic.name, count, f'{topic.name}: {every}{reason}')


def pass_over(what: str, best: TopicSurvey, topics: Sequence[TopicSurvey]) -> list[str]:
    """Return a note of the topics that were not chosen for a stream; empty without any."""
    others = ', '.join(f'{each.name} ({each.count})' for each in topics if each is not best)
    return [f'passed over for {what}: {others}'] if others else []
