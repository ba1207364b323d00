# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores as tables for a terminal of 80 columns: detections, trajectories, tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..model.boxes import Difficulty
from ..model.errors import format_count
from ..options.evaluation import Alignment
from .output import NONE, cell, console, figure_cells, number_cell, plain_table, say

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.table import Table

    from ..evaluation.detection import DetectionScores, WorstFrame
    from ..evaluation.object_benchmark import Curve, Scores
    from ..evaluation.odometry import OdometryScores
    from ..evaluation.tracking import TrackingScores
    from ..evaluation.trajectories import SegmentErrors
    from ..model.geometry import Float64Array


# Average precision, and the frames with the most errors.


def print_worst(worst: Sequence[WorstFrame]) -> None:
    """Print a table for a terminal of 80 columns."""
    say('')
    if not worst:
        say('no scored frame has errors')
        return
    table = plain_table('worst', ('frame', 'penalty'))
    table.add_column('errors', overflow='fold')
    for rank, frame in enumerate(worst, 1):
        table.add_row(f'{rank}', f'{frame.number:06d}', f'{frame.penalty:.2f}', cell(frame.reason))
    console().print(table)
    say('penalty: 1 for each missed label, the score for each false positive')


def print_detections(scores: DetectionScores) -> None:
    """Print tables for a terminal of 80 columns."""
    from ..evaluation.detection import LOOSE

    screen = console(soft_wrap=True)
    for table in _tables(scores.scores, scores.limits):
        screen.print()
        screen.print(table, soft_wrap=False)
    for table in _tables(scores.loose, LOOSE):
        screen.print()
        screen.print(table, soft_wrap=False)
    screen.print()
    say('average precision, percent; - has no objects, or is not evaluated')
    for note in scores.notes:
        say(f'note: {note}')
    if scores.worst is not None:
        print_worst(scores.worst)


def _tables(scores: Scores, limits: Mapping[str, float]) -> Iterator[Table]:
    """Yield the table of each class."""
    from ..evaluation.detection import ORIENTATION
    from ..evaluation.object_benchmark import Space

    shown_metrics = (Space.IMAGE.value, ORIENTATION, Space.GROUND.value, Space.SOLID.value)
    heads = [f'{level} {points}' for points in ('R40', 'R11') for level in ('easy', 'mod.', 'hard')]
    for class_name, metrics in scores.items():
        table = plain_table(f'{cell(class_name):<10} IoU {limits[class_name]:.2f}', heads)
        for metric in (name for name in shown_metrics if name in metrics):
            curves = [metrics[metric][level] for level in Difficulty]
            shown = [_figure(curve, 'r40') for curve in curves]
            table.add_row(metric, *shown, *(_figure(curve, 'r11') for curve in curves))
        table.add_row('objects', *_counts(metrics))
        yield table


def _counts(metrics: Mapping[str, Mapping[Difficulty, Curve | None]]) -> list[str]:
    """Return the numbers of labels that count, by level."""
    curves = [
        next((metric[level] for metric in metrics.values() if metric[level] is not None), None)
        for level in Difficulty
    ]
    return [NONE if curve is None else f'{curve.objects}' for curve in curves]


def _figure(curve: Curve | None, name: str) -> str:
    return NONE if curve is None or not curve.objects else f'{getattr(curve, name):.2f}'


# Errors of a trajectory.

_ALIGNMENTS = {
    Alignment.NONE: 'not aligned',
    Alignment.FIRST: 'first pose aligned',
    Alignment.SE3: 'all positions aligned, SE(3)',
    Alignment.SIM3: 'all positions aligned, Sim(3)',
    Alignment.SCALE: 'first pose aligned',
}


def print_trajectory(scores: OdometryScores) -> None:
    """Print tables for a terminal of 80 columns."""
    screen = console(soft_wrap=True)
    frames = format_count(len(scores.numbers), 'frame')
    say(f'{scores.name}: {frames}, {scores.distances_m[-1]:,.1f} m')
    say(f'ground truth: {scores.ground_truth}')
    say(f'result: {scores.result}')
    matched = int(scores.known.sum())
    say(f'{matched:,} of {frames} have a pose, by {scores.matched_by}; poses of camera 0')
    for note in scores.notes:
        say(f'note: {note}')
    say('')
    screen.print(_segments(scores.segments), soft_wrap=False)
    say('')
    screen.print(_errors(scores), soft_wrap=False)
    say(f'{_ALIGNMENTS[scores.alignment]}{_alignment_of(scores)}')


def _alignment_of(scores: OdometryScores) -> str:
    """Describe which figures are aligned: a scale changes segments, a rigid alignment does not."""
    if scores.alignment.has_scale:
        return f', scale {scores.errors.scale:.6g} for APE, RPE and segments'
    return ' for APE and RPE; segments do not depend on it'


def _segments(segments: SegmentErrors) -> Table:
    from ..evaluation.trajectories import LENGTHS_M

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


# Figures of tracks.

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
"""Heading of the column of a figure, by TrackEval's name."""


def print_tracks(scores: TrackingScores) -> None:
    """Print a table for a terminal of 80 columns."""
    names = ', '.join(scores.sequences)
    sequences = format_count(len(scores.sequences), 'sequence')
    say(f'{sequences} ({names}), {format_count(scores.frames, "frame")}')
    table = plain_table('class', _COLUMNS.values())
    for class_name, figures in scores.classes.items():
        table.add_row(class_name, *figure_cells(figures, _COLUMNS))
    console().print(table)
    if any(figures['HOTA'] is None for figures in scores.classes.values()):
        say('- has no objects and no tracks')
    for note in scores.notes:
        say(f'note: {note}')
