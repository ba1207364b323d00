# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval: detection, odometry, tracking, live."""

from __future__ import annotations

import re
import sys
from contextlib import closing, nullcontext
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from ..files.processes import keep_imports
from ..files.replaceable import losses_json
from ..model.boxes import Difficulty
from ..model.errors import format_count
from ..options.evaluation import (
    Alignment,
    make_detection_options,
    make_live_options,
    make_odometry_options,
    make_tracking_options,
)
from ..options.table import split_batch_options
from .command import (
    AllOverwriteOption,
    JsonOption,
    OverwriteOption,
    QuietOption,
    argument,
    out_option,
    takes,
)
from .output import (
    NONE,
    ResultOutput,
    cell,
    check_output,
    check_plot,
    figure_cells,
    format_path,
    is_picture,
    number_cell,
    plain_table,
    put_result,
    refuse_files,
    say,
    step_progress,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from rich.table import Table

    from ..evaluation.detection import DetectionScores, WorstFrame
    from ..evaluation.ground_truth import FrameBoxes
    from ..evaluation.live import LiveScores
    from ..evaluation.object_benchmark import Curve, Scores
    from ..evaluation.odometry import OdometryScores
    from ..evaluation.tracking import TrackingScores
    from ..evaluation.trajectories import SegmentErrors
    from ..model.errors import Loss
    from ..model.geometry import Float64Array
    from ..options.evaluation import DetectionOptions
    from ..options.read import ReadOptions
    from ..pictures.recording_frames import RecordingFrames


# The frames with the most errors: their table, their JSON, the folder with their pictures.

_PICTURE = re.compile(r'\d{2,}_\d{6,}\.png', re.ASCII)


def check_folder(
    out: Path | None, paths: Sequence[Path], *, overwrite: bool
) -> Callable[[Path], str | None]:
    """Raise now for a folder of pictures that could not be written later; return its refusal."""
    return check_output(out, paths, _keep_others, overwrite=overwrite)


def _keep_others(path: Path) -> str | None:
    """Return why --overwrite does not replace a path; None for pictures of worst frames."""
    if path.is_dir() and all(_PICTURE.fullmatch(each.name) for each in path.iterdir()):
        return None
    return 'it holds more than such pictures, so --overwrite does not touch it; choose another name'


def draw_worst(
    source: RecordingFrames,
    worst: Sequence[WorstFrame],
    found: FrameBoxes,
    options: DetectionOptions,
    out: Path,
    refusal: Callable[[Path], str | None],
    *,
    quiet: bool,
) -> tuple[Loss, ...]:
    """Draw frames with their errors into a new folder; return what could not be drawn."""
    from ..evaluation.worst_pictures import draw_worst_frames
    from ..files.staging import staged

    with (
        step_progress('drawing', len(worst), show=not quiet) as progress,
        staged(out, refusal) as folder,
    ):
        classes = options.limits.keys()
        return draw_worst_frames(
            source, worst, found.boxes, folder, options.overlaps, classes=classes, progress=progress
        )


def print_worst(worst: Sequence[WorstFrame]) -> None:
    """Print a table for a terminal of 80 columns."""
    from rich.console import Console

    say('')
    if not worst:
        say('no scored frame has errors')
        return
    table = plain_table('worst', ('frame', 'penalty'))
    table.add_column('errors', overflow='fold')
    for rank, each in enumerate(worst, 1):
        table.add_row(f'{rank}', f'{each.number:06d}', f'{each.penalty:.2f}', cell(each.reason))
    Console(highlight=False).print(table)
    say('penalty: 1 for each missed label, the score for each false positive')


# kitti-ros2 eval detection.


def _open_pictures(ground_truth: Path, read: ReadOptions) -> closing[RecordingFrames]:
    from ..evaluation.worst_pictures import open_pictures

    return closing(open_pictures(ground_truth, read))


def _draw_curves(
    scores: DetectionScores, results: Path, out: Path, refusal: Callable[[Path], str | None]
) -> None:
    from ..evaluation.detection import draw_curves
    from ..files.staging import staged_file

    with staged_file(out, refusal) as path:
        draw_curves(scores, f'{results}', path)


def print_detections(scores: DetectionScores) -> None:
    """Print tables for a terminal of 80 columns."""
    from rich.console import Console

    from ..evaluation.detection import LOOSE

    console = Console(highlight=False, soft_wrap=True)
    for table in _tables(scores.scores, scores.limits):
        console.print()
        console.print(table, soft_wrap=False)
    for table in _tables(scores.loose, LOOSE):
        console.print()
        console.print(table, soft_wrap=False)
    console.print()
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
    known = [
        next((metric[level] for metric in metrics.values() if metric[level] is not None), None)
        for level in Difficulty
    ]
    return [NONE if each is None else f'{each.objects}' for each in known]


def _figure(curve: Curve | None, name: str) -> str:
    return NONE if curve is None or not curve.objects else f'{getattr(curve, name):.2f}'


# kitti-ros2 eval odometry.

_ALIGNMENTS = {
    Alignment.NONE: 'not aligned',
    Alignment.FIRST: 'first pose aligned',
    Alignment.SE3: 'all positions aligned, SE(3)',
    Alignment.SIM3: 'all positions aligned, Sim(3)',
    Alignment.SCALE: 'first pose aligned',
}


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


# kitti-ros2 eval tracking.

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


# kitti-ros2 eval live.

_PRINT: dict[str, Callable[[Any], None]] = {
    'detection': print_detections,
    'odometry': print_trajectory,
    'tracking': print_tracks,
}


def _show(line: bytes) -> None:
    """Write a line of the node to standard error, whatever its bytes."""
    sys.stderr.write(line.decode(errors='replace'))


def _print(found: LiveScores) -> None:
    _PRINT[found.task](found.scores)
    say('')
    say(
        f'{format_count(found.frames, "frame")} sent, {len(found.latencies_ns):,} answered,'
        f' {len(found.missing):,} missing, {format_count(found.stragglers, "straggler")}'
    )
    latency = found.latency
    say(
        f'latency: median {latency.median_ms:.1f} ms, p95 {latency.p95_ms:.1f} ms,'
        f' maximum {latency.max_ms:.1f} ms'
    )
    for note in found.notes:
        if note not in found.scores.notes:  # those are printed with the scores
            say(f'note: {note}')
    if found.bag is not None:
        say(format_path(found.bag))


def _values(found: LiveScores) -> dict[str, object]:
    """Return what is printed as JSON: the document of the evaluation, and that of the run."""
    from ..evaluation.score_values import detection_values, odometry_values, tracking_values

    values_of: dict[str, Callable[[Any], dict[str, Any]]] = {
        'detection': detection_values,
        'odometry': odometry_values,
        'tracking': tracking_values,
    }
    run = {
        'frames': found.frames,
        'answered': len(found.latencies_ns),
        'missing': found.missing,
        'stragglers': found.stragglers,
        'latency': asdict(found.latency),
        'notes': found.notes,
        'losses': losses_json(found.losses),
    }
    return {**values_of[found.task](found.scores), 'live': run}


@takes('DETECTION_ALL', of='evaluation')
def eval_detection(
    ground_truth: Annotated[
        Path, argument('GROUND_TRUTH', 'label_2, an object split, or a recording with labels')
    ],
    results: Annotated[
        Path, argument('RESULTS', 'Folder of result files, 000000.txt ..., or a bag')
    ],
    out: Annotated[
        Optional[Path],
        out_option(
            'Curves to draw (.png, .pdf, .svg), or with --worst a folder for pictures; with'
            ' --all a folder of scores',
        ),
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score detections: average precision as KITTI's object benchmark.

    2D, orientation (AOS), bird's-eye view and 3D for easy, moderate and hard objects, exactly as
    the devkit computes them, at 40 (R40) and at 11 values of recall (R11). Frames without a result
    file are listed and not scored. With --all: each folder, file and bag of RESULTS to
    OUT/NAME.json, and a table.

    Examples:
      kitti-ros2 eval detection object results --frames val.txt --loose -o pr.png
      kitti-ros2 eval detection object results --worst 20 -o errors
    """
    from ..evaluation.detection import read_frames, score_frames
    from ..evaluation.score_values import detection_values as scores_json
    from ..files.processes import keep_freed_memory

    keep_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options, recorded = make_detection_options(given)
    if batch.whole:
        from .collection import EVAL_DETECTION, run_eval_collection

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_collection(EVAL_DETECTION, (ground_truth, results), given, batch, output)
    pictures = out is not None and options.worst is not None and not is_picture(out)
    check = check_folder if pictures else check_plot
    refusal = check(out, (ground_truth, results), overwrite=overwrite)
    with step_progress('reading', show=not quiet) as progress:
        files = count(1)
        truth, found = read_frames(
            ground_truth, results, read, recorded, lambda: progress(next(files))
        )
    with _open_pictures(ground_truth, read) if pictures else nullcontext() as source:
        scores = score_frames(truth, found, options)
        losses = scores.losses
        if out is not None and source is not None:
            worst = scores.worst or ()
            losses += draw_worst(source, worst, found, options, out, refusal, quiet=quiet)
        elif out is not None:
            _draw_curves(scores, results, out, refusal)

    def show() -> None:
        say(f'{results}: {format_count(scores.frames, "frame")}, labels of {ground_truth}')
        print_detections(scores)

        if out is not None:
            say(format_path(out))

    return put_result(lambda: scores_json(scores), show, losses, json=json, quiet=quiet)


@takes('ODOMETRY_ALL', of='evaluation')
def eval_odometry(
    ground_truth: Annotated[Path, argument('GT', 'A poses file, a sequence or drive, or a bag')],
    result: Annotated[Path, argument('RESULT', 'A poses file, a TUM file, or a bag')],
    out: Annotated[
        Optional[Path], out_option('Plot to draw (.png, .pdf, .svg); with --all a folder')
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing file at OUT')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score a trajectory: KITTI's segment errors, APE and RPE.

    Segments of 100 to 800 m as the odometry devkit computes them, in % and deg/m. Poses are
    converted to the rectified camera 0, and matched by frame number or by stamp. A poses file has
    12 numbers a line, or 13 with the frame number first. Frames without a pose are listed (exit
    code 1). With --all: each file and bag of RESULT to OUT/NAME.json, then all together.

    Examples:
      kitti-ros2 eval odometry poses/09.txt results/09.txt -o 09.png
      kitti-ros2 eval odometry odometry run.mcap --sequence 09 --topic /odom
    """
    from ..evaluation.odometry import score_odometry
    from ..evaluation.score_values import odometry_values as scores_json
    from ..files.staging import staged_file

    keep_imports()
    batch, given = split_batch_options(given)
    read, options = make_odometry_options(given)
    if batch.whole:
        from .collection import EVAL_ODOMETRY, run_eval_collection

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_collection(EVAL_ODOMETRY, (ground_truth, result), given, batch, output)
    refusal = check_plot(out, (ground_truth, result), overwrite=overwrite)
    scores = score_odometry(ground_truth, result, read, options)
    if out is not None:
        from ..evaluation.odometry import draw_odometry

        with staged_file(out, refusal) as path:
            draw_odometry(scores, path)

    def show() -> None:
        print_trajectory(scores)
        if out is not None:
            say(format_path(out))

    return put_result(lambda: scores_json(scores), show, scores.losses, json=json, quiet=quiet)


@takes('TRACKING_ALL', of='evaluation')
def eval_tracking(
    ground_truth: Annotated[Path, argument('GT', 'A tracking set with label_02, or label_02')],
    results: Annotated[Path, argument('RESULTS', 'A folder of files such as 0000.txt, or a bag')],
    out: Annotated[Optional[Path], out_option('With --all: folder of scores as JSON')] = None,
    overwrite: AllOverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Score tracks: HOTA, CLEAR-MOT and IDF1 of cars and pedestrians.

    TrackEval computes the figures by the rules of KITTI's tracking benchmark, on 2D boxes. A bag
    has the results of one sequence, matched to its frames by stamp; detection ids, or namespaces
    and ids of markers, are the tracks. Sequences without results are listed (exit code 1). With
    --all: each file and bag of RESULTS to OUT/NAME.json, then all together.

    Examples:
      kitti-ros2 eval tracking tracking/training results/data
      kitti-ros2 eval tracking tracking run.mcap --sequence 0000 --class-map 1=Car
    """
    from ..evaluation.score_values import tracking_values as scores_json
    from ..evaluation.tracking import score_tracking

    keep_imports()
    batch, given = split_batch_options(given)
    read, options = make_tracking_options(given)
    if batch.whole:
        from .collection import EVAL_TRACKING, run_eval_collection

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_collection(EVAL_TRACKING, (ground_truth, results), given, batch, output)
    refuse_files(out, overwrite=overwrite)
    with step_progress('scoring', show=not quiet) as progress:
        scores = score_tracking(ground_truth, results, read, options, progress)
    return put_result(
        lambda: scores_json(scores),
        lambda: print_tracks(scores),
        scores.losses,
        json=json,
        quiet=quiet,
    )


@takes('LIVE', of='evaluation')
def eval_live(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or a bag, with ground truth')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Play to a running stack, score its results, measure its latency.

    SRC is played lossless, with /clock: a frame is sent when the one before is answered. The node
    is started, its results are recorded, and it is stopped at the end. Boxes are scored as eval
    detection does, poses as eval odometry does. Latency is the time from publishing a scan to
    receiving the result with its stamp.

    Examples:
      kitti-ros2 eval live tracking --node 'python detector.py' --topic /boxes
      kitti-ros2 eval live drive_0005.mcap --node ./slam.sh --topic /odom --json
    """
    from ..evaluation.live import run_live
    from ..files.processes import keep_freed_memory

    keep_imports()
    keep_freed_memory()
    options, played = make_live_options(given)
    with step_progress('answered', show=not quiet) as progress:
        found = run_live(
            src, options, played, show=(lambda _: None) if quiet else _show, progress=progress
        )
    return put_result(
        lambda: _values(found), lambda: _print(found), found.losses, json=json, quiet=quiet
    )
