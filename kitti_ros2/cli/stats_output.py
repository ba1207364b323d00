# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics as tables on a terminal, and the file of their table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..datasets.statistics_rows import StatisticsRow
from ..files.replacing import keep_all_but_files
from .stats_comparison import comparisons
from .stats_tables import describe, describe_route, describe_sensors, tables_of
from .text import say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..datasets.set_statistics import SetStatistics

TABLE = 'statistics.csv'
"""Name of the table of a collection."""
KEEP_ALL_BUT_TABLES = keep_all_but_files(
    'table of statistics', (','.join(StatisticsRow._fields).encode(),)
)


def print_sets(sets: Sequence[SetStatistics], *, points: bool) -> None:
    """Print tables for a terminal of 80 columns."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    if len(sets) == 1:
        (found,) = sets
        console.print(describe(found), style='bold', markup=False)
        for line in (describe_sensors(found.total), describe_route(found.total)):
            if line:
                console.print(line, markup=False, soft_wrap=False)
        shown = tables_of(found)
    else:
        shown = comparisons(sets)
    for place, each in enumerate(shown):
        if place or len(sets) == 1:
            console.print()
        console.print(each, soft_wrap=False)
    for found in sets:
        if points and not found.total.points_a_scan.count:
            say(f'note: {found.path}: no scans, so no points are counted')
