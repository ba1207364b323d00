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

from ..files.output_rules import losses_json
from ..files.processes import freeze_imports
from ..model.errors import format_count
from ..options.evaluation import (
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
from .eval_tables import print_detections, print_tracks, print_trajectory
from .output import (
    ResultOutput,
    check_output,
    check_plot,
    format_path,
    is_picture,
    print_result,
    refuse_files,
    say,
    say_error,
    step_progress,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ..evaluation.detection import DetectionScores, WorstFrame
    from ..evaluation.live import LiveScores
    from ..model.boxes import Box
    from ..model.errors import Loss
    from ..options.evaluation import DetectionOptions
    from ..options.read import ReadOptions
    from ..pictures.recording_frames import RecordingFrames


# Pictures of the frames with the most errors.

_PICTURE = re.compile(r'\d{2,}_\d{6,}\.png', re.ASCII)


def check_folder(
    out: Path | None, paths: Sequence[Path], *, overwrite: bool
) -> Callable[[Path], str | None]:
    """Raise now for a folder of pictures that could not be written later; return its refusal."""
    return check_output(out, paths, _keep_others, overwrite=overwrite)


def _keep_others(path: Path) -> str | None:
    """Return why --overwrite does not replace a path; None for pictures of worst frames."""
    if path.is_dir() and all(_PICTURE.fullmatch(picture.name) for picture in path.iterdir()):
        return None
    return 'it holds more than such pictures, so --overwrite does not touch it; choose another name'


def draw_worst(
    source: RecordingFrames,
    worst: Sequence[WorstFrame],
    boxes: Mapping[int, Sequence[Box]],
    options: DetectionOptions,
    out: Path,
    refusal: Callable[[Path], str | None],
    *,
    quiet: bool,
) -> tuple[Loss, ...]:
    """Draw frames with their errors into a new folder; return the losses."""
    from ..evaluation.error_pictures import draw_worst_frames
    from ..files.staging import staged

    with (
        step_progress('drawing', len(worst), show=not quiet) as progress,
        staged(out, refusal) as folder,
    ):
        classes = options.limits.keys()
        return draw_worst_frames(
            source, worst, boxes, folder, options.overlaps, classes=classes, progress=progress
        )


# kitti-ros2 eval detection.


def _open_pictures(ground_truth: Path, read: ReadOptions) -> closing[RecordingFrames]:
    from ..evaluation.error_pictures import open_pictures

    return closing(open_pictures(ground_truth, read))


def _draw_curves(
    scores: DetectionScores, results: Path, out: Path, refusal: Callable[[Path], str | None]
) -> None:
    from ..evaluation.detection import draw_curves
    from ..files.staging import staged_file

    with staged_file(out, refusal) as path:
        draw_curves(scores, f'{results}', path)


# kitti-ros2 eval live.

_PRINT: dict[str, Callable[[Any], None]] = {
    'detection': print_detections,
    'odometry': print_trajectory,
    'tracking': print_tracks,
}


def _show(line: bytes) -> None:
    """Write a line of the node to standard error, whatever its bytes."""
    sys.stderr.write(line.decode(errors='replace'))


def _print(live: LiveScores) -> None:
    _PRINT[live.task](live.scores)
    say('')
    say(
        f'{format_count(live.frames, "frame")} sent, {len(live.latencies_ns):,} answered,'
        f' {len(live.missing):,} missing, {format_count(live.stragglers, "straggler")}'
    )
    latency = live.latency
    say(
        f'latency: median {latency.median_ms:.1f} ms, p95 {latency.p95_ms:.1f} ms,'
        f' maximum {latency.max_ms:.1f} ms'
    )
    for note in live.notes:
        if note not in live.scores.notes:  # those are printed with the scores
            say(f'note: {note}')
    if live.bag is not None:
        say(format_path(live.bag))


def _values(live: LiveScores) -> dict[str, object]:
    """Return the values for JSON: those of the evaluation, and those of the run."""
    from ..evaluation.score_values import detection_values, odometry_values, tracking_values

    values_of: dict[str, Callable[[Any], dict[str, Any]]] = {
        'detection': detection_values,
        'odometry': odometry_values,
        'tracking': tracking_values,
    }
    run = {
        'frames': live.frames,
        'answered': len(live.latencies_ns),
        'missing': live.missing,
        'stragglers': live.stragglers,
        'latency': asdict(live.latency),
        'notes': live.notes,
        'losses': losses_json(live.losses),
    }
    return {**values_of[live.task](live.scores), 'live': run}


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
      kitti-ros2 eval detection object results pr.png --frame-list val.txt --loose
      kitti-ros2 eval detection object results --worst 20 -o errors
    """
    from ..evaluation.detection import read_frames, score_frames
    from ..evaluation.score_values import detection_values as scores_json
    from ..files.processes import keep_freed_memory

    freeze_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options, recorded = make_detection_options(given)
    for name, overlap in options.classes if not quiet else ():
        if overlap is not None:
            say_error(
                f'note: --classes {name}={overlap:g} is --classes {name} --iou {name}={overlap:g}'
                f' now; the next release takes names alone'
            )
    if batch.whole:
        from .eval_all import EVAL_DETECTION, run_eval_all

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_all(EVAL_DETECTION, (ground_truth, results), given, batch, output)
    pictures = out is not None and options.worst is not None and not is_picture(out)
    check = check_folder if pictures else check_plot
    refusal = check(out, (ground_truth, results), overwrite=overwrite)
    with step_progress('reading', show=not quiet) as progress:
        files = count(1)
        truth, detected = read_frames(
            ground_truth, results, read, recorded, lambda: progress(next(files))
        )
    with _open_pictures(ground_truth, read) if pictures else nullcontext() as source:
        scores = score_frames(truth, detected, options)
        losses = scores.losses
        if out is not None and source is not None:
            worst = scores.worst or ()
            losses += draw_worst(source, worst, detected.boxes, options, out, refusal, quiet=quiet)
        elif out is not None:
            _draw_curves(scores, results, out, refusal)

    def show() -> None:
        say(f'{results}: {format_count(scores.frames, "frame")}, labels of {ground_truth}')
        print_detections(scores)

        if out is not None:
            say(format_path(out))

    return print_result(lambda: scores_json(scores), show, losses, json=json, quiet=quiet)


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
    12 numbers a line, or 13 with the frame number first, as a result of KITTI-360 needs. Frames
    without a pose are listed (exit code 1). With --all: each file and bag of RESULT to
    OUT/NAME.json, then all together.

    Examples:
      kitti-ros2 eval odometry poses/09.txt results/09.txt -o 09.png
      kitti-ros2 eval odometry odometry run.mcap --sequence 09 --topic /odom
    """
    from ..evaluation.odometry import score_odometry
    from ..evaluation.score_values import odometry_values as scores_json
    from ..files.staging import staged_file

    freeze_imports()
    batch, given = split_batch_options(given)
    read, options = make_odometry_options(given)
    if batch.whole:
        from .eval_all import EVAL_ODOMETRY, run_eval_all

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_all(EVAL_ODOMETRY, (ground_truth, result), given, batch, output)
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

    return print_result(lambda: scores_json(scores), show, scores.losses, json=json, quiet=quiet)


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

    freeze_imports()
    batch, given = split_batch_options(given)
    read, options = make_tracking_options(given)
    if batch.whole:
        from .eval_all import EVAL_TRACKING, run_eval_all

        output = ResultOutput(out, overwrite, json, quiet)
        return run_eval_all(EVAL_TRACKING, (ground_truth, results), given, batch, output)
    refuse_files(out, overwrite=overwrite)
    with step_progress('scoring', show=not quiet) as progress:
        scores = score_tracking(ground_truth, results, read, options, progress)
    return print_result(
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

    freeze_imports()
    keep_freed_memory()
    options, played = make_live_options(given)
    with step_progress('answered', show=not quiet) as progress:
        live = run_live(
            src, options, played, show=(lambda _: None) if quiet else _show, progress=progress
        )
    return print_result(
        lambda: _values(live), lambda: _print(live), live.losses, json=json, quiet=quiet
    )
