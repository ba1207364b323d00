# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a conversion as a table for a terminal, and as values for JSON."""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..model.streams import Stream
from ..model.text import one_line
from .tables import cell, plain_table
from .text import format_count, say

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from rich.table import Table

    from ..importer.plan_overview import PlannedTopic, PlanOverview
    from ..own_bags.outlook import Outlook

_MOST_PASSED_OVER = 12
_PASSED_OVER = '-'
_PASSED = 'passed over: '
_SHORT = {Stream.CALIBRATION.value: 'calib'}
"""Names of streams in the table where theirs are long."""


def print_plan(names: str, outlook: Outlook, overview: PlanOverview) -> None:
    """Print which topic becomes which stream, and what is passed over.

    Args:
        names: Of the bags.
        outlook: The plan and how it was made.
        overview: What it makes of the bags.
    """
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    console.print(one_line(f'{names}: {_head(outlook, overview)}'), style='bold', markup=False)
    console.print(_topic_table(overview), soft_wrap=False)
    if overview.passed_over:
        say(f'{_PASSED_OVER}: passed over in this layout')


def _head(outlook: Outlook, overview: PlanOverview) -> str:
    plan = overview.plan
    because = f' ({outlook.reason})' if outlook.reason else ''
    head = f'layout {plan.layout.value}{because}, {plan.name}'
    if overview.frames is None:
        return head
    return f'{head}, {format_count(overview.frames, "frame")}, one for each {plan.reference}'


def _topic_table(overview: PlanOverview) -> Table:
    table = plain_table('stream', ())
    table.add_column('topic', overflow='fold')
    table.add_column('type', overflow='fold')
    table.add_column('count', justify='right', no_wrap=True)
    table.add_column('Hz', justify='right', no_wrap=True)
    table.add_column('frame', overflow='fold')
    for each in overview.used:
        _add(table, ' '.join(_SHORT.get(name, name) for name in each.streams), each)
    for each in overview.passed_over[:_MOST_PASSED_OVER]:
        _add(table, _PASSED_OVER, each)
    more = len(overview.passed_over) - _MOST_PASSED_OVER
    if more > 0:
        table.add_row(_PASSED_OVER, f'{more} more; all with --json', '', '', '', '')
    return table


def _add(table: Table, stream: str, topic: PlannedTopic) -> None:
    rate = '' if topic.rate_hz is None else f'{topic.rate_hz:.1f}'
    kind = topic.msgtype.rsplit('/', 1)[-1]
    table.add_row(stream, cell(topic.topic), cell(kind), f'{topic.count}', rate, cell(topic.frame))


def print_remarks(outlook: Outlook, overview: PlanOverview) -> None:
    """Print why a conversion would fail, the notes, and the layouts to choose from."""
    from rich.console import Console

    for fault in overview.faults:
        say(f'cannot be converted: {fault}')
    for note in _joined(dict.fromkeys((*outlook.notes, *overview.notes))):
        say(f'note: {note}')
    if outlook.layouts:
        table = plain_table('layout')
        table.add_column('streams', overflow='fold')
        for layout, streams in outlook.layouts.items():
            shown = ' (shown)' if layout is outlook.plan.layout else ''
            table.add_row(layout.value + shown, ' '.join(streams))
        Console(highlight=False).print(table)


def _joined(notes: Iterable[str]) -> Iterator[str]:
    """Yield notes, those on single topics that are passed over as one, where the first is."""
    notes = list(notes)
    parts = [note.removeprefix(_PASSED).partition('; ') for note in notes if _is_single(note)]
    for note in notes:
        if not _is_single(note):
            yield note
        elif parts:
            yield _PASSED + '; '.join(f'{topic}, {reason}' for topic, _, reason in parts)
            parts = []


def _is_single(note: str) -> bool:
    return note.startswith(_PASSED) and '; ' in note


def print_next(commands: Iterable[tuple[str, str]]) -> None:
    """Print commands that may follow, each below its purpose."""
    say('Next:')
    for purpose, command in commands:
        sys.stdout.write(f'  # {one_line(purpose)}\n  {one_line(command)}\n')


def plan_values(
    paths: Iterable[Path], outlook: Outlook, overview: PlanOverview
) -> dict[str, object]:
    """Return a plan and what it makes of bags, for JSON."""
    return {
        'bags': list(paths),
        'layout': overview.plan.layout.value,
        'frames': overview.frames,
        'topics': [asdict(each) for each in overview.used],
        'passed_over': [asdict(each) for each in overview.passed_over],
        'faults': overview.faults,
        'notes': tuple(dict.fromkeys((*outlook.notes, *overview.notes))),
        'layouts': _by_name(outlook),
        'plan': asdict(overview.plan),
    }


def _by_name(outlook: Outlook) -> Mapping[str, object]:
    """Return the streams of each possible layout."""
    if outlook.layouts is None:
        return {}
    return {layout.value: streams for layout, streams in outlook.layouts.items()}
