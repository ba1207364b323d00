# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions of work and its results; both are pickled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from .units import WorkUnit

Advance: TypeAlias = Callable[[int, int], None]
"""Called with the samples done and the number of all."""


@dataclass(frozen=True)
class UnitJob:
    """A unit with all that is needed to run it.

    Attributes:
        unit: The unit.
        out: Its output.
        options: Values of the command's options by name.
        attempt: 1, or more after a worker process was lost.
    """

    unit: WorkUnit
    out: Path
    options: Mapping[str, object]
    attempt: int = 1


@dataclass(frozen=True)
class UnitResult:
    """The result of a unit.

    Attributes:
        counts: What was written: frames, messages, bytes.
        bad: Number of samples and files that were skipped.
        losses: What was skipped, one line for each reason; the first few.
        notes: Non-fatal remarks.
        reason: Why it failed; empty if it did not.
        seconds: Time taken.
    """

    counts: Mapping[str, int] = field(default_factory=dict)
    bad: int = 0
    losses: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reason: str = ''
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether there is no output."""
        return bool(self.reason)


@dataclass(frozen=True)
class LostWorker:
    """A worker process ended in the middle of a unit.

    Attributes:
        how: By which signal, or with which exit code.
    """

    how: str
