# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The events of a playback, and the clock that schedules them. No ROS, no disk."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import threading


@dataclass(frozen=True)
class Send:
    """The sample at a position is due; due_ns is steady time, in nanoseconds."""

    position: int
    due_ns: int


@dataclass(frozen=True)
class Jump:
    """A seek: resend latched messages, delete stale markers."""

    position: int
    stamp_ns: int


@dataclass(frozen=True)
class Tick:
    """The recording's time is due for publishing."""

    stamp_ns: int


@dataclass(frozen=True)
class Idle:
    """Nothing is due for a number of nanoseconds; None while paused or waiting."""

    for_ns: int | None


Event: TypeAlias = 'Send | Jump | Tick | Idle'


class SteadyClock:
    """The monotonic clock of the machine, with a wait."""

    @staticmethod
    def now_ns() -> int:
        """Return monotonic time in nanoseconds."""
        return time.monotonic_ns()

    @staticmethod
    def wait(condition: threading.Condition, seconds: float | None) -> None:
        """Wait for a notification or a timeout; the condition is held."""
        condition.wait(seconds)
