# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Rules about the stamps of a stream and of its samples relative to the scans.

Limits, from raw drives 0001 and 0005: periods are 0.099 to 0.111 s, cameras and oxts come 9 to 24
ms after the scan of the same number, turns take 0.102 to 0.105 s.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..kitti.turns import turn_length
from ..model.stamps import NS_PER_S, format_stamp
from ..model.text import format_count
from .rule import Breach, Rule, RuleScope, RuleSeverity, breach_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from ..kitti.text_file import Lines
    from ..model.samples import Int64Array

_EARLIEST_NS = 946_684_800 * NS_PER_S
"""2000-01-01 UTC: clocks that were not set begin in 1970 or 1980."""
_DAY_NS = 86_400 * NS_PER_S
_WIDE_GAP = 3.5
_PAIRED_NS = NS_PER_S // 20


@dataclass(frozen=True, eq=False)
class StampsFile:
    """The stamps of a stream, line n for file number n.

    Attributes:
        path: The file.
        lines: Its stamps, nanoseconds.
        relative: Whether they are seconds from the start of the sequence.
        scans: Those of the scans of the same numbers, None where these are not the same moments.
        ends: Path and lines of the ends of turns, where path has their starts.
    """

    path: Path
    lines: Lines[int]
    relative: bool = False
    scans: Sequence[int | None] | None = None
    ends: Sequence[int | None] | None = None

    def known(self) -> tuple[Int64Array, Int64Array]:
        """Return the numbers of valid lines, from 0, and their stamps."""
        valid = self.lines.sound()
        return np.array(list(valid), np.int64), np.array(list(valid.values()), np.int64)


def _find_invalid(file: StampsFile) -> Iterator[Breach]:
    for error in file.lines.errors.values():
        yield breach_of(error, file.path)


def _find_backward(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.known()
    for place in np.flatnonzero(np.diff(stamps) < 0).tolist():
        text = f'{_ms(stamps[place] - stamps[place + 1])} before the stamp above'
        yield Breach(text, file.path, int(numbers[place + 1]) + 1)


def _find_repeated(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.known()
    for place in np.flatnonzero(np.diff(stamps) == 0).tolist():
        yield Breach('the same stamp as above', file.path, int(numbers[place + 1]) + 1)


def _find_gaps(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.known()
    periods = np.diff(stamps) / np.maximum(np.diff(numbers), 1)
    positive = periods[periods > 0]
    if len(positive) < 3:  # too few for a usual period
        return
    usual = float(np.median(positive))
    for place in np.flatnonzero(periods > _WIDE_GAP * usual).tolist():
        text = f'{_ms(periods[place])} after the stamp above; usual are {_ms(usual)}'
        yield Breach(text, file.path, int(numbers[place + 1]) + 1)


def _find_implausible(file: StampsFile) -> Iterator[Breach]:
    numbers, stamps = file.known()
    latest = time.time_ns() + _DAY_NS
    wrong = np.zeros(0, np.int64) if file.relative else np.flatnonzero(
        (stamps < _EARLIEST_NS) | (stamps > latest)
    )  # fmt: skip
    if len(wrong):
        first = int(wrong[0])
        count = format_count(len(wrong), 'stamp')
        text = f'{count}, the first is {format_stamp(int(stamps[first]))}'
        yield Breach(text, file.path, int(numbers[first]) + 1)


def _find_unpaired(file: StampsFile) -> Iterator[Breach]:
    if file.scans is None or file.ends is not None:
        return
    for number, stamp in file.lines.sound().items():
        scan = file.scans[number] if number < len(file.scans) else None
        if scan is not None and abs(stamp - scan) > _PAIRED_NS:
            text = f'{_ms(abs(stamp - scan))} from the scan of the same number'
            yield Breach(text, file.path, number + 1)


def _find_turns(file: StampsFile) -> Iterator[Breach]:
    if file.ends is None or file.scans is None:
        return
    for number, start in file.lines.sound().items():
        inside = max(number, 0) < min(len(file.ends), len(file.scans))
        end, forward = (file.ends[number], file.scans[number]) if inside else (None, None)
        if end is None or forward is None:
            continue
        if turn_length(start, end) is None or not start <= forward <= end:
            text = (
                f'a turn of {_ms(end - start)}; its scan is {_ms(forward - start)} after its start'
            )
            yield Breach(text, file.path, number + 1)


def _ms(nanoseconds: float) -> str:
    milliseconds = nanoseconds / 1e6
    return f'{milliseconds:.0f} ms' if abs(milliseconds) < 10_000 else f'{milliseconds / 1e3:.0f} s'


_STREAM = RuleScope.STREAM
_ERROR = RuleSeverity.ERROR
_WARNING = RuleSeverity.WARNING

STAMP_RULES: tuple[Rule[StampsFile], ...] = (
    Rule(
        'stamps-line',
        _ERROR,
        _STREAM,
        'Lines of time stamps can be parsed, and are within 1970 to 2038',
        'correct the line: YYYY-MM-DD HH:MM:SS.nnnnnnnnn, in odometry seconds',
        _find_invalid,
    ),
    Rule(
        'stamps-order',
        _ERROR,
        _STREAM,
        'Stamps do not go back',
        'check the clock of the recorder, and the order of the lines',
        _find_backward,
    ),
    Rule(
        'stamps-repeated',
        _WARNING,
        _STREAM,
        'Stamps are not repeated',
        'check whether a sample was written twice',
        _find_repeated,
    ),
    Rule(
        'stamps-gap',
        _WARNING,
        _STREAM,
        'Periods are at most 3.5 times the usual one',
        'samples were dropped, or lines are missing',
        _find_gaps,
    ),
    Rule(
        'stamps-date',
        _WARNING,
        _STREAM,
        'Stamps are between 2000 and today',
        'check whether the clock of the recorder was set',
        _find_implausible,
    ),
    Rule(
        'stamps-pair',
        _WARNING,
        _STREAM,
        'Samples of one number are within 50 ms of the scan (raw, synchronized)',
        'check that no line or file is missing: numbers pair the streams',
        _find_unpaired,
    ),
    Rule(
        'stamps-turn',
        _WARNING,
        _STREAM,
        'Turns of the scanner take up to 1 s, and contain the stamp of their scan',
        'check timestamps_start.txt and timestamps_end.txt',
        _find_turns,
    ),
)
