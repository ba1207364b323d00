# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Units of a collection as tables, lines and JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from ..batch.manifest import DONE, FAILED, MANIFEST
from .exit_codes import EXIT_LOSSES
from .tables import cell, plain_table
from .text import complain, format_bytes, format_count, format_duration, format_path, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..batch.manifest import UnitRecord
    from ..batch.pace import Pace

_SHOWN = 20
_COUNTED = {
    'to-bag': ('frames', 'messages', 'bytes'),
    'to-kitti': ('frames', 'files', 'bytes'),
    'validate': ('files', 'bytes', 'warnings'),
    'stats': ('frames', 'objects'),
    'report': ('frames', 'bytes'),
}
"""By command what is counted of a unit."""
_FRAMES = ('frames',)
_HEADINGS = {'bytes': 'size'}
_BAD = {'validate': ('error', 'errors'), 'report': ('loss', 'losses')}
_SKIPPED = ('skipped', 'skipped')


def record_json(record: UnitRecord) -> dict[str, object]:
    """Return a unit of the manifest for print_json."""
    values = asdict(record)
    identity = values.pop('identity')
    return {**values, 'source': identity['source'], 'version': identity['version']}


def print_groups(groups: Mapping[str, Sequence[UnitRecord]], command: str) -> None:
    """Print a row of sums for each group of units of a command."""
    from rich.console import Console

    counted = _COUNTED.get(command, _FRAMES)
    headings = [_HEADINGS.get(name, name) for name in counted]
    table = plain_table('units', ['count', *headings, _BAD.get(command, _SKIPPED)[1]])
    for name, units in groups.items():
        sums = {key: sum(each.counts.get(key, 0) for each in units) for key in counted}
        table.add_row(
            cell(name),
            f'{len(units):,}',
            *(format_bytes(n) if key == 'bytes' else f'{n:,}' for key, n in sums.items()),
            f'{sum(each.bad for each in units):,}',
        )
    Console(highlight=False).print(table)


def complain_of(records: Sequence[UnitRecord], command: str) -> None:
    """Print failed units, and what is bad in others, on standard error."""
    singular, plural = _BAD.get(command, _SKIPPED)
    failed = [each for each in records if each.state == FAILED]
    lossy = [each for each in records if each.state == DONE and each.bad]
    lines = [f'failed {each.name}: {each.reason}' for each in failed]
    lines += [f'{singular} in {each.name}: {text}' for each in lossy for text in each.losses]
    for line in lines[:_SHOWN]:
        complain(line)
    if len(lines) > _SHOWN:
        complain(f'... and {len(lines) - _SHOWN} more; kitti-ros2 status OUT --json lists them')
    if failed or lossy:
        count = sum(each.bad for each in lossy)
        complain(
            f'kitti-ros2: {format_count(len(failed), "unit")} failed, {count}'
            f' {singular if count == 1 else plural} in'
            f' {format_count(len(lossy), "unit")}; exit code {EXIT_LOSSES}'
        )


def print_pace(out: Path, pace: Pace) -> None:
    """Print how much is left, and how fast it goes."""
    say(
        f'{format_path(out / MANIFEST)}: {pace.states[DONE]:,} done, {pace.states[FAILED]:,}'
        f' failed, {pace.left:,} left'
    )
    if pace.recent and pace.recent_seconds > 0:
        left = pace.seconds_left or 0.0
        say(
            f'last run: {format_count(pace.recent, "unit")} in {pace.recent_seconds:.1f} s'
            f' ({pace.recent * 3600 / pace.recent_seconds:,.0f} units/hour{_rate(pace)})'
            + (f'; about {format_duration(round(left * 1e9))} left' if pace.left else '')
        )


def _rate(pace: Pace) -> str:
    """Return the bytes per second of the last run; empty if none are counted."""
    per_second = pace.recent_bytes / pace.recent_seconds
    return f', {per_second / 1e6:.0f} MB/s' if pace.recent_bytes else ''
