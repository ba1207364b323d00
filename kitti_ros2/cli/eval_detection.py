# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval detection."""

from __future__ import annotations

from contextlib import closing, nullcontext
from itertools import count
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..model.difficulty import Difficulty
from ..options.batch import split_batch_options
from ..options.evaluation_tables import make_detection_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .plot_output import check_plot, is_picture
from .progress import step_progress
from .tables import NONE, cell, plain_table
from .text import format_count, format_path, say, show_losses
from .worst_frames import check_folder, draw_worst, print_worst

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from rich.table import Table

    from ..evaluation.detection import DetectionScores
    from ..evaluation.object_benchmark import Curve, Scores
    from ..options.read import ReadOptions
    from ..pictures.frame import FrameSource
    from .result_output import ResultOutput



def run_eval_detection(
    ground_truth: Path,
    results: Path,
    given: Mapping[str, object],
    output: ResultOutput,
) -> int:
    """Print the scores of detections.

    Args:
        ground_truth: The labels.
        results: The result files, or a bag.
        given: The options of eval detection.
        output: Where and how the scores are put; `out` is the chart to draw, or a folder for
            pictures of the worst frames.

    Returns:
        The exit code: 1 where frames or lines could not be scored.
    """
    from ..evaluation.detection import score_frames
    from ..evaluation.detection_inputs import read_frames
    from ..evaluation.score_values import detection_values as scores_json
    from ..files.freed_memory import keep_freed_memory

    keep_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options, recorded = make_detection_options(given)
    if batch.whole:
        from .eval_collection import EVAL_DETECTION, run_eval_collection

        return run_eval_collection(EVAL_DETECTION, (ground_truth, results), given, batch, output)
    out = output.out
    pictures = out is not None and options.worst is not None and not is_picture(out)
    check = check_folder if pictures else check_plot
    refusal = check(out, (ground_truth, results), overwrite=output.overwrite)
    with step_progress('reading', show=not output.quiet) as progress:
        files = count(1)
        truth, found = read_frames(
            ground_truth, results, read, recorded, lambda: progress(next(files))
        )
    with _open_pictures(ground_truth, read) if pictures else nullcontext() as source:
        scores = score_frames(truth, found, options)
        losses = scores.losses
        if out is not None and source is not None:
            worst = scores.worst or ()
            losses += draw_worst(source, worst, found, options, out, refusal, quiet=output.quiet)
        elif out is not None:
            _draw_curves(scores, results, out, refusal)
    if output.json:
        print_json(scores_json(scores))
    elif not output.quiet:
        say(f'{results}: {format_count(scores.frames, "frame")}, labels of {ground_truth}')
        print_detections(scores)
        if out is not None:
            say(format_path(out))
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _open_pictures(ground_truth: Path, read: ReadOptions) -> closing[FrameSource]:
    from ..evaluation.worst_pictures import open_pictures

    return closing(open_pictures(ground_truth, read))


def _draw_curves(
    scores: DetectionScores, results: Path, out: Path, refusal: Callable[[Path], str | None]
) -> None:
    from ..evaluation.detection_plot import draw_curves
    from ..files.staging import staged_file

    with staged_file(out, refusal) as path:
        draw_curves(scores, f'{results}', path)


def print_detections(scores: DetectionScores) -> None:
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
    if scores.worst is not None:
        print_worst(scores.worst)


def _tables(scores: Scores, limits: Mapping[str, float]) -> Iterator[Table]:
    """Yield the table of each class."""
    from ..evaluation.detection import ORIENTATION
    from ..evaluation.overlap import Space

    shown_metrics = (Space.IMAGE.value, ORIENTATION, Space.GROUND.value, Space.SOLID.value)
    heads = [f'{level} {points}' for points in ('R40', 'R11') for level in ('easy', 'mod.', 'hard')]
    for class_name, metrics in scores.items():
        table = plain_table(f'{cell(class_name):<10} IoU {limits[class_name]:.2f}', heads)
        for metric in (name for name in shown_metrics if name in metrics):
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
    return [NONE if each is None else f'{each.objects}' for each in known]


def _figure(curve: Curve | None, name: str) -> str:
    return NONE if curve is None or not curve.objects else f'{getattr(curve, name):.2f}'
