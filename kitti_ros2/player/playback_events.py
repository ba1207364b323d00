# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The events of a playback, and the clock that they are due by. No ROS, no disk."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    import threading


@dataclass(frozen=True)
class Send:
    """The sample at a position is due; due_ns is steady time, in nanoseconds."""

    position: int
    due_ns: int


@dataclass(frozen=True)
class Jump:
    """The position was moved: what subscribers keep of another time must be renewed."""

    position: int
    stamp_ns: int


@dataclass(frozen=True)
class Tick:
    """The recording's time is to be told."""

    stamp_ns: int


@dataclass(frozen=True)
class Idle:
    """Nothing is due for a while: so many nanoseconds, None while paused or waiting."""

    for_ns: int | None


Event: TypeAlias = 'Send | Jump | Tick | Idle'


class PlaybackClock(Protocol):
    """Steady time, and waiting in it."""

    def now_ns(self) -> int:
        """Nanoseconds that only ever grow."""

    def wait(self, condition: threading.Condition, seconds: float | None) -> None:
        """Wait for a notification, at most so long; the condition is held."""


class SteadyClock:
    """The machine's own."""

    @staticmethod
    def now_ns() -> int:
        """As PlaybackClock has it."""
        return time.monotonic_ns()

    @staticmethod
    def wait(condition: threading.Condition, seconds: float | None) -> None:
        """As PlaybackClock has it."""
        condition.wait(seconds)
