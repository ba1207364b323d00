# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval live."""

from __future__ import annotations

import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..files.kept_imports import keep_imports
from ..options.evaluation_tables import make_live_options
from .eval_detection import print_detections
from .eval_odometry import print_trajectory
from .eval_tracking import print_tracks
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .progress import step_progress
from .text import format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from ..evaluation.live import LiveScores

_PRINT: dict[str, Callable[[Any], None]] = {
    'detection': print_detections,
    'odometry': print_trajectory,
    'tracking': print_tracks,
}


def run_eval_live(src: Path, given: Mapping[str, object], *, json: bool, quiet: bool) -> int:
    """Score a running stack and print the scores and its latency.

    Args:
        src: A KITTI folder or a bag.
        given: Options by name.
        json: Whether to print JSON instead of tables.
        quiet: Print only losses, and nothing of the node.

    Returns:
        The exit code: 1 if a frame has no answer, or something could not be played or scored.
    """
    from ..evaluation.live import run_live
    from ..files.freed_memory import keep_freed_memory

    keep_imports()
    keep_freed_memory()
    options, played = make_live_options(given)
    with step_progress('answered', show=not quiet) as progress:
        found = run_live(
            src, options, played, show=(lambda _: None) if quiet else _show, progress=progress
        )
    if json:
        print_json(_values(found))
    elif not quiet:
        _print(found)
    show_losses(found.losses)
    return EXIT_LOSSES if found.losses else EXIT_OK


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
