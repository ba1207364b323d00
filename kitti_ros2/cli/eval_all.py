# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval ... --all: scores of many results, a row for each, and of all together."""

from __future__ import annotations

import json as json_module
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..batch.collection import Collection
from ..batch.job_functions import run_detection_job, run_odometry_job, run_tracking_job
from ..batch.jobs import DETECTION, ODOMETRY, TRACKING, find_pairs
from ..evaluation.score_values import combined_odometry, combined_tracking
from ..evaluation.track_metrics import check_trackeval
from ..evaluation.trajectories import check_evo
from ..model.boxes import Difficulty
from ..model.errors import BadFileError
from ..options.evaluation import (
    make_detection_options,
    make_odometry_options,
    make_tracking_options,
)
from .output import PLOTS, cell, console, figure_cells, number_cell, plain_table
from .run_all import Combined, output_folder, run_collection

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..batch.jobs import PairKind
    from ..batch.manifest import JobRecord
    from ..batch.pool import RunJob
    from ..options.read import ReadOptions
    from ..options.table import BatchOptions
    from .output import ResultOutput

    Values = Mapping[str, Any]
    Rows = Iterator[tuple[str, Sequence[str]]]

_TRACKED = ('HOTA', 'DetA', 'AssA', 'MOTA', 'MOTP', 'IDF1', 'IDSW')
_DETECTED = ('2d', 'aos', 'bev', '3d')


@dataclass(frozen=True)
class Evaluation:
    """An evaluation of a collection.

    Attributes:
        name: The word after eval.
        kind: Ground truth and results that it compares.
        run: Runs a job.
        read: Returns the options that choose among the ground truth, from values by name.
        columns: Headings of the table of results.
        rows: The rows of a result: a class, or nothing, and the cells.
        combine: Returns the figures of all results together, as the JSON of a result; None if they
            do not follow from those of each.
        check: Raises an error if a library is missing.
    """

    name: str
    kind: PairKind
    run: RunJob
    read: Callable[[Mapping[str, object]], ReadOptions]
    columns: Sequence[str]
    rows: Callable[[Values], Rows]
    combine: Callable[[Sequence[Values]], dict[str, Any]] | None = None
    check: Callable[[], None] = lambda: None


def run_eval_all(
    evaluation: Evaluation,
    paths: tuple[Path, Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Score each result of a collection, and print the figures of each.

    Args:
        evaluation: The evaluation.
        paths: Ground truth and results: roots, globs or lists.
        given: The options of a job by name.
        batch: How the collection is run.
        output: Where and how the scores are put.

    Returns:
        The exit code.
    """
    read = evaluation.read(given)
    folder = output_folder(read, output.out, PLOTS)
    evaluation.check()
    truth, results = paths
    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection(
        f'eval {evaluation.name}', folder, '.json', chosen, batch, evaluation.run
    )
    return run_collection(
        collection,
        lambda search: find_pairs(truth, results, evaluation.kind, read.layout, search),
        lambda done: _combine(evaluation, done),
        json=output.json,
        quiet=output.quiet,
    )


def _combine(evaluation: Evaluation, done: Sequence[tuple[JobRecord, Path]]) -> Combined:
    """Return the scores of all jobs, and those of all together."""

    def read() -> dict[str, Values]:
        return {record.name: _read_scores(path) for record, path in done}

    def values() -> dict[str, object]:
        scores = read()
        shown = {
            name: {key: figure for key, figure in figures.items() if key != 'parts'}
            for name, figures in scores.items()
        }
        return {'scores': shown, 'combined': _together(evaluation, [*scores.values()]) or None}

    def show() -> None:
        scores = read()
        together = _together(evaluation, [*scores.values()])
        if scores:
            all_rows = [('all', together)] if together else []
            _print_scores(evaluation, [*scores.items(), *all_rows])

    return Combined(values, show)


def _together(evaluation: Evaluation, scores: Sequence[Values]) -> Values:
    """Return the figures of all together; empty if a ground truth is used twice."""
    truths = {(values['ground_truth'], values['sequence']) for values in scores}
    if evaluation.combine is None or len(scores) < 2 or len(truths) < len(scores):
        return {}
    return evaluation.combine(scores)


def _print_scores(evaluation: Evaluation, scores: Sequence[tuple[str, Values]]) -> None:
    """Print a table with a row for each result."""
    table = plain_table('result', evaluation.columns)
    for name, values in scores:
        for part, cells in evaluation.rows(values):
            table.add_row(cell(f'{name} {part}'.rstrip()), *cells)
    console().print(table)


def _read_scores(path: Path) -> Values:
    try:
        values: dict[str, Any] = json_module.loads(path.read_text('utf-8'))
    except ValueError as error:
        raise BadFileError(
            path, f'{error}', 'the scores of a result', remedy='remove it, and run again'
        ) from None
    return values


def _odometry_rows(values: Values) -> Rows:
    for errors in values['odometry'].values():
        yield (
            '',
            (
                f'{errors["segments"]}',
                number_cell(errors['t_err_percent'], 4),
                number_cell(errors['r_err_deg_per_m'], 6),
                number_cell(errors['ape_m'], 4),
                number_cell(errors['rpe_m'], 4),
            ),
        )


def _tracking_rows(values: Values) -> Rows:
    for class_name, figures in values['tracking'].items():
        yield class_name, figure_cells(figures, _TRACKED)


def _detection_rows(values: Values) -> Rows:
    for class_name, metrics in values['detection'].items():
        levels = [metrics.get(name, {}).get(Difficulty.MODERATE.value, {}) for name in _DETECTED]
        yield class_name, [number_cell(level.get('R40')) for level in levels]


EVAL_DETECTION = Evaluation(
    'detection',
    DETECTION,
    run_detection_job,
    lambda given: make_detection_options(given)[0],
    _DETECTED,
    _detection_rows,
)
EVAL_TRACKING = Evaluation(
    'tracking',
    TRACKING,
    run_tracking_job,
    lambda given: make_tracking_options(given)[0],
    (*_TRACKED[:-1], 'IDs'),
    _tracking_rows,
    lambda scores: {'tracking': combined_tracking(scores)},
    check_trackeval,
)
EVAL_ODOMETRY = Evaluation(
    'odometry',
    ODOMETRY,
    run_odometry_job,
    lambda given: make_odometry_options(given)[0],
    ('segments', 't_err %', 'r_err deg/m', 'APE m', 'RPE m'),
    _odometry_rows,
    lambda scores: {'odometry': {'all': combined_odometry(scores)}},
    check_evo,
)
