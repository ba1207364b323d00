# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How a recording or a bag is played."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from ..model.errors import UsageError


class AtEnd(str, Enum):
    """What a player does when everything is played."""

    EXIT = 'exit'
    PAUSE = 'pause'


class Stamps(str, Enum):
    """Which stamps a player's messages carry: the recording's, or those of the moment."""

    ORIGINAL = 'original'
    NOW = 'now'


RATES = (0.01, 100.0)
MOST_STEP = 10_000
MOST_SUBSCRIBERS = 1000


@dataclass(frozen=True)
class PlaybackOptions:
    """How something is played.

    Attributes:
        rate: Seconds of recording a second, 0.01 to 100.
        loop: How many times it is played; 0 without end.
        start_paused: Whether it waits for a resume.
        delay_ns: Nanoseconds before the first message, from when the subscribers are there.
        clock_hz: How often the recording's time is told; 0 never.
        step: Frames that one play_next plays; 0 is a single sample.
        lossless: Whether it goes as fast as subscribers take it, not by time.
        wait_for: Subscribers to wait for before it begins; None is 1 with lossless, else 0.
        at_end: What happens when everything is played.

    Raises:
        UsageError: A value is out of range.
    """

    rate: float = 1.0
    loop: int = 1
    start_paused: bool = False
    delay_ns: int = 0
    clock_hz: float = 100.0
    step: int = 1
    lossless: bool = False
    wait_for: int | None = None
    at_end: AtEnd = AtEnd.EXIT

    def __post_init__(self) -> None:
        if not RATES[0] <= self.rate <= RATES[1]:
            raise UsageError(f'rate {self.rate:g} is not within {RATES[0]:g} to {RATES[1]:g}')
        if self.loop < 0:
            raise UsageError(f'loop {self.loop} is negative; it is a number of rounds, 0 no end')
        if self.delay_ns < 0:
            raise UsageError(f'delay {self.delay_ns / 1e9:g} is negative, seconds')
        if not 0 <= self.clock_hz <= 1000:
            raise UsageError(f'clock {self.clock_hz:g} is not within 0 to 1000, times a second')
        if not 0 <= self.step <= MOST_STEP:
            raise UsageError(f'step {self.step} is not within 0 to {MOST_STEP} frames')
        if not 0 <= self.subscribers <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 0 to {MOST_SUBSCRIBERS}')

    @property
    def subscribers(self) -> int:
        """How many subscribers it waits for before it begins."""
        return int(self.lossless) if self.wait_for is None else self.wait_for
