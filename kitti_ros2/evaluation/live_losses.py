# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What happened in a run of a stack: its answers; what it did not answer, as losses and notes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..model.losses import Loss
from ..model.stamps import format_stamp
from ..model.text import format_count

if TYPE_CHECKING:
    from ..player.answers import Answers


@dataclass
class LiveRun:
    """What happened in a run.

    Attributes:
        answers: The answers of the stack.
        topic: The topic with its results.
        msgtype: The type of the topic.
        losses: What the stack did not answer, and what could not be played.
        notes: Other remarks, one line each.
    """

    answers: Answers
    topic: str
    msgtype: str = ''
    losses: list[Loss] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def missing(self) -> tuple[int, ...]:
        """The frames that were sent and not answered."""
        answered = self.answers.latencies_ns
        return tuple(number for number in self.answers.frames() if number not in answered)


def why_nothing(run: LiveRun, problem: str) -> str:
    """Describe why no frame was answered; problem is what ended the run, empty for nothing."""
    answers = run.answers
    frames = format_count(len(answers.frames()), 'frame')
    said = f'{run.topic}: no frame was answered ({frames} sent)'
    if problem:
        said += f'; {problem}'
    if answers.between:
        said += f'; {format_count(answers.between, "message")} with a stamp between two frames'
    return f'{said}; {_describe_strays(answers)}' if answers.strays else said


def enter_losses(run: LiveRun, problem: str, total: int) -> None:
    """Enter what was not sent or answered into the losses and notes of a run.

    Args:
        run: With its answers.
        problem: What ended the run early, empty for nothing.
        total: Number of frames to send.
    """
    answers = run.answers
    sent = len(answers.frames())
    missing = run.missing
    if problem and (missing or sent < total):
        reason = f'{problem}; {sent} of {total} frames were sent'
        run.losses.append(Loss(run.topic, max(1, total - sent), reason))
    elif sent < total:
        count = format_count(total - sent, 'frame')
        run.notes.append(f'{count} of {total} have nothing that the node subscribes to')
    if missing:
        run.losses.append(Loss(run.topic, len(missing), 'no answer to frames {}', missing))
    if answers.strays:
        run.losses.append(Loss(run.topic, answers.strays, _describe_strays(answers)))
    if answers.repeated:
        run.notes.append(f'{answers.repeated} more messages for frames answered before')
    if answers.between:
        run.notes.append(f'{answers.between} more messages with a stamp between two frames')
    if answers.on_the_way > 1:
        run.notes.append(
            f'up to {answers.on_the_way} frames were on their way at once, because an answer came'
            f' late or not at all; latencies include the wait'
        )


def _describe_strays(answers: Answers) -> str:
    first = answers.first_stray_ns
    shown = 'none' if first is None or first < 0 else format_stamp(first)
    return (
        f'{format_count(answers.strays, "message")} with the stamp of no frame, the first'
        f' {shown}; a result must have the stamp of the scan or image that it was made from'
    )
