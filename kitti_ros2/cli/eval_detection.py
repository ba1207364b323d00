# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval detection."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

from ..evaluation.detection import ORIENTATION, score_paths
from ..evaluation.overlap import Space
from ..files.staging import staged_file
from ..model.difficulty import Difficulty
from ..options.evaluation_tables import make_detection_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .memory import keep_freed_memory, keep_imports
from .plot_output import check_plot
from .progress import step_progress
from .tables import cell, plain_table
from .text import format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from rich.table import Table

    from ..evaluation.detection import DetectionScores
    from ..evaluation.object_benchmark import Curve, Scores

_METRICS = (Space.IMAGE.value, ORIENTATION, Space.GROUND.value, Space.SOLID.value)
_NONE = '-'


def run_eval_detection(
    ground_truth: Path,
    results: Path,
    given: Mapping[str, object],
    *,
    out: Path | None,
    overwrite: bool,
    json: bool,
    quiet: bool,
) -> int:
    """Print the scores of detections.

    Args:
        ground_truth: The labels.
        results: The result files, or a bag.
        given: The options of eval detection.
        out: The chart to draw, None for none.
        overwrite: Whether an existing chart may be replaced.
        json: Whether to print JSON instead of tables.
        quiet: Print only losses.

    Returns:
        The exit code: 1 where frames or lines could not be scored.
    """
    keep_imports()
    keep_freed_memory()
    read, options, recorded = make_detection_options(given)
    refusal = check_plot(out, (ground_truth, results), overwrite=overwrite)
    with step_progress('reading', show=not quiet) as progress:
        files = count(1)
        scores = score_paths(
            ground_truth, results, read, options, recorded, lambda: progress(next(files))
        )
    if out is not None:
        from ..evaluation.detection_plot import draw_curves

        with staged_file(out, refusal) as path:
            draw_curves(scores, f'{results}', path)
    if json:
        print_json(scores_json(scores))
    elif not quiet:
        say(f'{results}: {format_count(scores.frames, "frame")}, labels of {ground_truth}')
        print_scores(scores)
        if out is not None:
            say(format_path(out))
    show_losses(scores.losses)
    return EXIT_LOSSES if scores.losses else EXIT_OK


def scores_json(scores: DetectionScores) -> dict[str, object]:
    """Return the scores as they are printed as JSON."""
    return scores.percent()


def print_scores(scores: DetectionScores) -> None:
    """Print tables for a terminal of 80 columns."""
    from rich.console import Console

    from ..evaluation.detection import LOOSE

    console = Console(highlight=False, soft_wrap=True)
    for each in _tables(scores.scores, scores.limits):
        console.print()
        console.print(each, soft_wrap=False)
    for each in _tables(scores.loose, LOOSE):
        console.print()
        console.print(each, soft_wrap=False)
    console.print()
    say('average precision, percent; - has no objects, or is not evaluated')
    for note in scores.notes:
        say(f'note: {note}')


def _tables(scores: Scores, limits: Mapping[str, float]) -> Iterator[Table]:
    """Yield the table of each class."""
    heads = [f'{level} {points}' for points in ('R40', 'R11') for level in ('easy', 'mod.', 'hard')]
    for class_name, metrics in scores.items():
        table = plain_table(f'{cell(class_name):<10} IoU {limits[class_name]:.2f}', heads)
        for metric in (name for name in _METRICS if name in metrics):
            curves = [metrics[metric][level] for level in Difficulty]
            shown = [_figure(each, 'r40') for each in curves]
            table.add_row(metric, *shown, *(_figure(each, 'r11') for each in curves))
        table.add_row('objects', *_counts(metrics))
        yield table


def _counts(metrics: Mapping[str, Mapping[Difficulty, Curve | None]]) -> list[str]:
    """Return the numbers of labels that count, by level."""
    known = [
        next((each[level] for each in metrics.values() if each[level] is not None), None)
        for level in Difficulty
    ]
    return [_NONE if each is None else f'{each.objects}' for each in known]


def _figure(curve: Curve | None, name: str) -> str:
    return _NONE if curve is None or not curve.objects else f'{getattr(curve, name):.2f}'
