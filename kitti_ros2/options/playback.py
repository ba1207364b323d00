# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Options of playing a recording or a bag."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from ..model.errors import UsageError
from .declare import check_bounds, choice, option
from .parsers import parse_flag, parse_integer, parse_number, parse_rounds
from .quantity_parsers import parse_seconds_ns


class AtEnd(str, Enum):
    """Action of a player at the end of the recording."""

    EXIT = 'exit'
    PAUSE = 'pause'


class Stamps(str, Enum):
    """Stamps of a player's messages: those of the recording, or the current time."""

    ORIGINAL = 'original'
    NOW = 'now'


RATES = (0.01, 100.0)
MOST_SUBSCRIBERS = 1000
_MOST_ROUNDS = 2**31 - 1


@dataclass(frozen=True)
class PlaybackOptions:
    """Options of playing.

    Attributes:
        rate: Seconds of recording per second, 0.01 to 100.
        loop: Number of rounds; 0 is endless.
        start_paused: Whether it waits for a resume.
        delay_ns: Nanoseconds before the first message, after the wait for subscribers.
        clock_hz: How often the recording's time is published, 0 to 1000; 0 never.
        step: Frames that one play_next plays; 0 is a single sample.
        lossless: Whether it goes as fast as subscribers keep up, instead of in real time.
        wait_for: Subscribers to wait for before it begins; None is 1 with lossless, else 0.
        at_end: What happens at the end of the recording.

    Raises:
        UsageError: A value is out of range.
    """

    group: ClassVar = 'Playback'

    rate: float = option(
        1.0,
        'Seconds of recording per second, 0.01 to 100',
        parse_number,
        bounds=RATES,
        flags=('-r',),
        live=True,
    )
    loop: int = option(
        1, 'Number of rounds; 0 or true is endless', parse_rounds, live=True, any_type=True
    )
    start_paused: bool = option(False, 'Wait for a resume', parse_flag, flags=('-p',))
    delay_ns: int = option(
        0,
        'Seconds before the first message, after the wait for subscribers',
        parse_seconds_ns,
        name='delay',
        bounds=(0.0, 3600.0),
        flags=('-d',),
    )
    clock_hz: float = option(
        100.0,
        '/clock messages per second; 0 is none',
        parse_number,
        name='clock',
        bounds=(0.0, 1000.0),
    )
    step: int = option(
        1,
        'Frames that one play_next plays; 0 is a single sample',
        parse_integer,
        bounds=(0, 10_000),
        live=True,
    )
    lossless: bool = option(
        False, 'As fast as subscribers keep up; no message is dropped', parse_flag
    )
    wait_for: int | None = option(
        None,
        'Wait until so many nodes subscribe to any of the topics, and 1 s more without a new'
        ' subscription',
        parse_integer,
        unset='1 with lossless, else 0',
        any_type=True,
    )
    at_end: AtEnd = choice(AtEnd.EXIT, 'Exit, or pause and wait for a seek', AtEnd)

    def __post_init__(self) -> None:
        check_bounds(self, 'rate', 'clock', 'step')
        if not 0 <= self.loop <= _MOST_ROUNDS:
            raise UsageError(
                f'loop {self.loop} is not within 0 to {_MOST_ROUNDS}; it is a number of rounds, 0'
                f' is endless'
            )
        if self.delay_ns < 0:
            raise UsageError(f'delay {self.delay_ns / 1e9:g} is negative, seconds')
        if not 0 <= self.subscribers <= MOST_SUBSCRIBERS:
            raise UsageError(f'wait_for {self.wait_for} is not within 0 to {MOST_SUBSCRIBERS}')

    @property
    def subscribers(self) -> int:
        """Number of subscribers to wait for before it begins."""
        return int(self.lossless) if self.wait_for is None else self.wait_for
