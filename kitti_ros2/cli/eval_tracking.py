# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval tracking."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..options.batch import split_batch_options
from ..options.evaluation_tables import make_tracking_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .progress import step_progress
from .tables import figure_cells, plain_table
from .text import format_count, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..evaluation.tracking import TrackingScores
    from .result_output import ResultOutput

_COLUMNS = {
    'HOTA': 'HOTA',
    'DetA': 'DetA',
    'AssA': 'AssA',
    'MOTA': 'MOTA',
    'MOTP': 'MOTP',
    'IDF1': 'IDF1',
    'IDSW': 'IDs',
    'Frag': 'FRAG',
    'MT': 'MT',
    'PT': 'PT',
    'ML': 'ML',
}
"""By TrackEval's name of a figure the heading of its column."""


def run_eval_tracking(
    ground_truth: Path,
    results: Path,
    given: Mapping[str, object],
    output: ResultOutput,
) -> int:
    """Print the scores of tracks.

    Args:
        ground_truth: A tracking set.
        results: A folder of a tracker's files, one of them, or a bag.
        given: Options by name.
        output: Where and how the scores are put.

    Returns:
        The exit code: 1 where sequences or frames have no results, or lines could not be used.

    Raises:
        UsageError: Options do not go together.
    """
    from ..evaluation.score_values import tracking_values as scores_json
    from ..evaluation.tracking import score_tracking

    keep_imports()
    batch, given = split_batch_options(given)
    read, options = make_tracking_options(given)
    if batch.whole:
        from .eval_collection import EVAL_TRACKING, run_eval_collection

        return run_eval_collection(EVAL_TRACKING, (ground_truth, results), given, batch, output)
    output.refuse_files()
    with step_progress('scoring', show=not output.quiet) as progress:
        scores = score_tracking(ground_truth, results, read, options, progress)
    if output.json:
        print_json(scores_json(scores))
    elif not output.quiet:
        print_tracks(scores)
    show_losses(scores.losses)
    return EXIT_LOSSES if scores.losses else EXIT_OK


def print_tracks(scores: TrackingScores) -> None:
    """Print a table for a terminal of 80 columns."""
    from rich.console import Console

    names = ', '.join(scores.sequences)
    sequences = format_count(len(scores.sequences), 'sequence')
    say(f'{sequences} ({names}), {format_count(scores.frames, "frame")}')
    table = plain_table('class', _COLUMNS.values())
    for class_name, figures in scores.classes.items():
        table.add_row(class_name, *figure_cells(figures, _COLUMNS))
    Console(highlight=False).print(table)
    if any(figures['HOTA'] is None for figures in scores.classes.values()):
        say('- has no objects and no tracks')
    for note in scores.notes:
        say(f'note: {note}')
