# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval ... --all: scores of many results, a row for each, and of all together."""

from __future__ import annotations

import json as json_module
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ..batch.collection import Collection
from ..batch.evaluation_units import run_detection_unit, run_odometry_unit, run_tracking_unit
from ..batch.pairs import DETECTION, ODOMETRY, TRACKING, find_pairs
from ..evaluation.collected_scores import combined_odometry, combined_tracking
from ..evaluation.pose_errors import check_evo
from ..evaluation.track_metrics import check_trackeval
from ..model.difficulty import Difficulty
from ..model.errors import BadFileError
from ..options.evaluation_tables import (
    make_detection_options,
    make_odometry_options,
    make_tracking_options,
)
from .collection import Combined, need_folder, refuse_sequence, run_collection
from .plot_output import PLOTS
from .tables import cell, figure_cells, number_cell, plain_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..batch.manifest import UnitRecord
    from ..batch.pairs import PairKind
    from ..batch.pool import RunUnit
    from ..options.batch import BatchOptions
    from ..options.read import ReadOptions

    Values = Mapping[str, Any]
    Rows = Iterator[tuple[str, Sequence[str]]]
    from .result_output import ResultOutput

_TRACKED = ('HOTA', 'DetA', 'AssA', 'MOTA', 'MOTP', 'IDF1', 'IDSW')
_DETECTED = ('2d', 'aos', 'bev', '3d')


@dataclass(frozen=True)
class Evaluation:
    """An evaluation of a collection.

    Attributes:
        name: The word after eval.
        kind: What it compares.
        run: Runs a unit.
        read: Returns the options that choose among the ground truth, from values by name.
        columns: Headings of the table of results.
        rows: The rows of a result: a class, or nothing, and the cells.
        combine: Returns the figures of all results together, as the JSON of a result; None if they
            do not follow from those of each.
        check: Raises an error if a library is missing.
    """

    name: str
    kind: PairKind
    run: RunUnit
    read: Callable[[Mapping[str, object]], ReadOptions]
    columns: Sequence[str]
    rows: Callable[[Values], Rows]
    combine: Callable[[Sequence[Values]], dict[str, Any]] | None = None
    check: Callable[[], None] = lambda: None


def run_eval_collection(
    evaluation: Evaluation,
    paths: tuple[Path, Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Score each result of a collection, and print the figures of each.

    Args:
        evaluation: What is scored.
        paths: Ground truth and results: roots, globs or lists.
        given: The options of a unit by name.
        batch: How the collection is run.
        output: Where and how the scores are put.

    Returns:
        The exit code.
    """
    read = evaluation.read(given)
    refuse_sequence(read)
    folder = need_folder(output.out, PLOTS)
    evaluation.check()
    truth, results = paths
    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection(
        f'eval {evaluation.name}', folder, '.json', chosen, batch, evaluation.run
    )
    return run_collection(
        collection,
        lambda search: find_pairs(truth, results, evaluation.kind, read.layout, search),
        quiet=output.quiet,
        json=output.json,
        combine=lambda done: _Scores(evaluation, done),
    )


class _Scores(Combined):
    """The scores of all units, and those of all together."""

    def __init__(self, evaluation: Evaluation, done: Sequence[tuple[UnitRecord, Path]]) -> None:
        self._evaluation = evaluation
        self._done = done

    @cached_property
    def _found(self) -> dict[str, Values]:
        return {record.name: _read_scores(path) for record, path in self._done}

    @cached_property
    def _together(self) -> dict[str, Any]:
        """The figures of all together; empty if a ground truth is used twice."""
        found = [*self._found.values()]
        truths = {(each['ground_truth'], each['sequence']) for each in found}
        combine = self._evaluation.combine
        if combine is None or len(found) < 2 or len(truths) < len(found):
            return {}
        return combine(found)

    def values(self) -> dict[str, Any]:
        """Return the scores of each and of all together for print_json."""
        kept = {
            name: {key: value for key, value in each.items() if key != 'parts'}
            for name, each in self._found.items()
        }
        return {'scores': kept, 'combined': self._together or None}

    def show(self) -> None:
        """Print a table with a row for each result."""
        from rich.console import Console

        if not self._found:
            return
        table = plain_table('result', self._evaluation.columns)
        shown = [*self._found.items(), *([('all', self._together)] if self._together else [])]
        for name, values in shown:
            for part, cells in self._evaluation.rows(values):
                table.add_row(cell(f'{name} {part}'.rstrip()), *cells)
        Console(highlight=False).print(table)


def _read_scores(path: Path) -> Values:
    try:
        values: dict[str, Any] = json_module.loads(path.read_text('utf-8'))
    except ValueError as error:
        raise BadFileError(
            path, f'{error}', 'the scores of a result', remedy='remove it, and run again'
        ) from None
    return values


def _odometry_rows(values: Values) -> Rows:
    for each in values['odometry'].values():
        yield (
            '',
            (
                f'{each["segments"]}',
                number_cell(each['t_err_percent'], 4),
                number_cell(each['r_err_deg_per_m'], 6),
                number_cell(each['ape_m'], 4),
                number_cell(each['rpe_m'], 4),
            ),
        )


def _tracking_rows(values: Values) -> Rows:
    for class_name, each in values['tracking'].items():
        yield class_name, figure_cells(each, _TRACKED)


def _detection_rows(values: Values) -> Rows:
    for class_name, metrics in values['detection'].items():
        levels = [metrics.get(name, {}).get(Difficulty.MODERATE.value, {}) for name in _DETECTED]
        yield class_name, [number_cell(each.get('R40')) for each in levels]


EVAL_DETECTION = Evaluation(
    'detection',
    DETECTION,
    run_detection_unit,
    lambda given: make_detection_options(given)[0],
    _DETECTED,
    _detection_rows,
)
EVAL_TRACKING = Evaluation(
    'tracking',
    TRACKING,
    run_tracking_unit,
    lambda given: make_tracking_options(given)[0],
    (*_TRACKED[:-1], 'IDs'),
    _tracking_rows,
    lambda found: {'tracking': combined_tracking(found)},
    check_trackeval,
)
EVAL_ODOMETRY = Evaluation(
    'odometry',
    ODOMETRY,
    run_odometry_unit,
    lambda given: make_odometry_options(given)[0],
    ('segments', 't_err %', 'r_err deg/m', 'APE m', 'RPE m'),
    _odometry_rows,
    lambda found: {'odometry': {'all': combined_odometry(found)}},
    check_evo,
)
