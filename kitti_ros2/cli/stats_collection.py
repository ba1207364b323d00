# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stats --all: each recording and bag, and all together."""

from __future__ import annotations

import json as json_module
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..bags.search import is_bag_name
from ..batch.collection import Collection
from ..batch.folders import common_folder, find_all_roots
from ..batch.source_units import find_source_units
from ..batch.statistics_unit import run_statistics_unit
from ..datasets.set_statistics import SetStatistics
from ..datasets.statistics_rows import plain_values, read_values, write_csv
from ..files.staging import staged_file
from ..model.errors import BadFileError
from ..options.dataset_tables import make_statistics_options
from .collection import Combined, need_folder, refuse_sequence, run_collection
from .plot_output import PLOTS
from .stats_output import KEEP_ALL_BUT_TABLES, TABLE, print_sets
from .text import format_path, say

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..batch.manifest import UnitRecord
    from ..options.batch import BatchOptions
    from .result_output import ResultOutput


def run_statistics_collection(
    paths: Sequence[Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Count what is in each unit of a collection; print all together, and write their table.

    Args:
        paths: Roots, globs or lists.
        given: The options of a unit by name.
        batch: How the collection is run.
        output: Where and how the statistics are put.

    Returns:
        The exit code.
    """
    read, options = make_statistics_options(given)
    refuse_sequence(read)
    folder = need_folder(output.out, PLOTS)
    roots = find_all_roots(paths, is_bag_name)

    def combine(done: Sequence[tuple[UnitRecord, Path]]) -> _Together:
        found = _Together(common_folder(roots), done, folder / TABLE, points=options.points)
        found.write()
        return found

    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection('stats', folder, '.json', chosen, batch, run_statistics_unit)
    return run_collection(
        collection,
        lambda search: find_source_units(roots, read.layout, search),
        quiet=output.quiet,
        json=output.json,
        combine=combine,
    )


class _Together(Combined):
    """The statistics of all units together."""

    def __init__(
        self,
        root: Path,
        done: Sequence[tuple[UnitRecord, Path]],
        table: Path,
        *,
        points: bool,
    ) -> None:
        self._root = root
        self._done = done
        self._table = table
        self._points = points

    @cached_property
    def _sets(self) -> list[SetStatistics]:
        recordings = [
            replace(each, name=record.name)
            for record, path in self._done
            for each in _read_statistics(path).recordings
        ]
        return [SetStatistics(self._root, tuple(recordings))] if recordings else []

    def write(self) -> None:
        """Write the table; one of an earlier run is replaced."""
        with staged_file(self._table, KEEP_ALL_BUT_TABLES) as path:
            write_csv(path, self._sets)

    def values(self) -> dict[str, Any]:
        """Return the total for print_json."""
        return {'total': plain_values(self._sets[0])['total']} if self._sets else {}

    def show(self) -> None:
        """Print the tables of the total."""
        if self._sets:
            print_sets(self._sets, points=self._points)
        say(format_path(self._table))


def _read_statistics(path: Path) -> SetStatistics:
    try:
        return read_values(json_module.loads(path.read_text('utf-8')))
    except (ValueError, TypeError, KeyError) as error:
        raise BadFileError(
            path, f'{error}', 'the statistics of a unit', remedy='remove it, and run again'
        ) from None
