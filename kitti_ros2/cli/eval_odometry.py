# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval odometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..options.batch import split_batch_options
from ..options.eval_odometry import Alignment
from ..options.evaluation_tables import make_odometry_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .plot_output import check_plot
from .tables import number_cell, plain_table
from .text import format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rich.table import Table

    from ..evaluation.odometry import OdometryScores
    from ..evaluation.segment_errors import SegmentErrors
    from ..model.geometry import Float64Array
    from .result_output import ResultOutput

_ALIGNMENTS = {
    Alignment.NONE: 'not aligned',
    Alignment.FIRST: 'first pose aligned',
    Alignment.SE3: 'all positions aligned, SE(3)',
    Alignment.SIM3: 'all positions aligned, Sim(3)',
    Alignment.SCALE: 'first pose aligned',
}


def run_eval_odometry(
    ground_truth: Path,
    result: Path,
    given: Mapping[str, object],
    output: ResultOutput,
) -> int:
    """Print the scores of a trajectory.

    Args:
        ground_truth: A poses file, a KITTI folder or a bag.
        result: A poses file, a TUM file or a bag.
        given: Options by name.
        output: Where and how the scores are put; `out` is the plot to draw.

    Returns:
        The exit code: 1 where frames have no pose, or data could not be used.
    """
    from ..evaluation.odometry import score_trajectory
    from ..evaluation.score_values import odometry_values as scores_json
    from ..files.staging import staged_file

    keep_imports()
    batch, given = split_batch_options(given)
    read, options = make_odometry_options(given)
    if batch.whole:
        from .eval_collection import EVAL_ODOMETRY, run_eval_collection

        return run_eval_collection(EVAL_ODOMETRY, (ground_truth, result), given, batch, output)
    out = output.out
    refusal = check_plot(out, (ground_truth, result), overwrite=output.overwrite)
    scores = score_trajectory(ground_truth, result, read, options)
    if out is not None:
        from ..evaluation.odometry_plot import draw_odometry

        with staged_file(out, refusal) as path:
            draw_odometry(scores, path)
    if output.json:
        print_json(scores_json(scores))
    elif not output.quiet:
        print_trajectory(scores)
        if out is not None:
            say(format_path(out))
    show_losses(scores.losses)
    return EXIT_LOSSES if scores.losses else EXIT_OK


def print_trajectory(scores: OdometryScores) -> None:
    """Print tables for a terminal of 80 columns."""
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    frames = format_count(len(scores.numbers), 'frame')
    say(f'{scores.name}: {frames}, {scores.distances_m[-1]:,.1f} m')
    say(f'ground truth: {scores.ground_truth}')
    say(f'result: {scores.result}')
    matched = int(scores.known.sum())
    say(f'{matched:,} of {frames} have a pose, by {scores.matched_by}; poses of camera 0')
    for note in scores.notes:
        say(f'note: {note}')
    say('')
    console.print(_segments(scores.segments), soft_wrap=False)
    say('')
    console.print(_errors(scores), soft_wrap=False)
    say(f'{_ALIGNMENTS[scores.alignment]}{_alignment_of(scores)}')


def _alignment_of(scores: OdometryScores) -> str:
    """Say which figures are aligned: a rigid alignment changes no segment, a scale does."""
    if scores.alignment.has_scale:
        return f', scale {scores.errors.scale:.6g} for APE, RPE and segments'
    return ' for APE and RPE; segments do not depend on it'


def _segments(segments: SegmentErrors) -> Table:
    from ..evaluation.segment_errors import LENGTHS_M

    table = plain_table('KITTI', ('segments', 't_err %', 'r_err deg/m'))
    for length in LENGTHS_M:
        part = segments.of_length(length)
        if len(part):
            table.add_row(f'{length} m', *_segment_cells(part))
    table.add_row('all', *_segment_cells(segments))
    return table


def _segment_cells(part: SegmentErrors) -> tuple[str, ...]:
    return f'{len(part)}', number_cell(part.t_err_percent, 4), number_cell(part.r_err_deg_per_m, 6)


def _errors(scores: OdometryScores) -> Table:
    table = plain_table('metres', ('RMSE', 'mean', 'median', 'max'))
    table.add_row('APE', *_error_cells(scores.errors.ape_m, scores.ape_m))
    table.add_row('RPE, frame to frame', *_error_cells(scores.errors.rpe_m, scores.rpe_m))
    return table


def _error_cells(errors: Float64Array, root: float | None) -> tuple[str, ...]:
    import numpy as np

    if not len(errors):
        return ('-',) * 4
    values = root, errors.mean(), np.median(errors), errors.max()
    return tuple(number_cell(value, 4) for value in values)
