# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores of a run: what is checked before it, and the evaluation of its results after it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from ..bags.locate import looks_like_bag
from ..model.errors import UsageError
from ..model.text import some_of
from ..options.evaluation_tables import (
    make_detection_options,
    make_odometry_options,
    make_tracking_options,
)
from .detection import score_paths
from .ground_truth_labels import read_ground_truth
from .odometry import score_trajectory
from .open_trajectories import open_truth
from .pose_errors import check_evo
from .track_metrics import check_trackeval
from .track_sources import find_sequences
from .tracking import score_tracking

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from .live_losses import LiveRun

    Given = Mapping[str, object]


def check_task(task: str, source: Path, played: Given) -> None:
    """Check that results can be scored: there is ground truth, and what is needed is installed.

    Args:
        task: The evaluation.
        source: The ground truth.
        played: The options of the player.

    Raises:
        KittiRos2Error: They cannot.
    """
    _TASKS[task].check(source, _of_truth(task, played))


def score_results(
    task: str, source: Path, bag: Path, played: Given, run: LiveRun, align: str | None = None
) -> Any:  # noqa: ANN401 - DetectionScores, TrackingScores or OdometryScores
    """Score the results in a bag with the ground truth of a source.

    Losses that concern frames without an answer are left out: those of the run name them.

    Args:
        task: The evaluation.
        source: The ground truth.
        bag: The results.
        played: The options of the player.
        run: The run, whose frames are scored.
        align: How poses are aligned; None is the default.
    """
    given = {**_of_truth(task, played), 'topic': run.topic}
    if task == 'odometry':
        given['align'] = align
    scores = _TASKS[task].score(source, bag, given, run)
    answered = run.answers.latencies_ns
    losses = (loss.among(answered) for loss in scores.losses)
    return replace(scores, losses=tuple(loss for loss in losses if loss is not None))


def _of_truth(task: str, played: Given) -> Given:
    """Return the options of the player that are those of the ground truth, too."""
    names = {'sequence'} if task == 'tracking' else {'layout', 'sequence'}
    return {name: value for name, value in played.items() if name in names}


def _check_detection(source: Path, given: Given) -> None:
    read, _, _ = make_detection_options(given)
    read_ground_truth(source, read)


def _score_detection(source: Path, bag: Path, given: Given, _: LiveRun) -> Any:  # noqa: ANN401
    return score_paths(source, bag, *make_detection_options(given))


def _check_tracking(source: Path, given: Given) -> None:
    check_trackeval()
    if looks_like_bag(source):
        raise UsageError(
            f'{source}: is a bag, whose tracks are not read as ground truth; give the KITTI folder'
            f' that it was made from'
        )
    read, _ = make_tracking_options(given)
    names = [each.name for each in find_sequences(source, read)]
    if len(names) > 1:
        raise UsageError(f'{source}: choose what is played with --sequence ({some_of(names)})')


def _score_tracking(source: Path, bag: Path, given: Given, run: LiveRun) -> Any:  # noqa: ANN401
    options = make_tracking_options(given)
    return score_tracking(
        source, bag, *options, lambda _done, _total: None, {*run.answers.frames()}
    )


def _check_odometry(source: Path, given: Given) -> None:
    check_evo()
    open_truth(source, *make_odometry_options(given))


def _score_odometry(source: Path, bag: Path, given: Given, run: LiveRun) -> Any:  # noqa: ANN401
    return score_trajectory(source, bag, *make_odometry_options(given), {*run.answers.frames()})


class _Task(NamedTuple):
    check: Callable[[Path, Given], None]
    score: Callable[[Path, Path, Given, LiveRun], Any]


_TASKS = {
    'detection': _Task(_check_detection, _score_detection),
    'tracking': _Task(_check_tracking, _score_tracking),
    'odometry': _Task(_check_odometry, _score_odometry),
}
