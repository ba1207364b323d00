# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Scores a running stack: its results on a recording that is played to it, and its latency."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api.keywords import by_name
from ..api.source import warn
from ..files.remote import as_path
from ..files.staging import refuse_inside
from ..node.installed import check_installed
from ..options.evaluation_tables import LIVE, make_live_options
from .live_run import record_run
from .live_scores import check_task, score_results

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping

    from typing_extensions import Unpack

    from ..api.keywords import LiveKeywords
    from ..model.losses import Loss
    from ..options.eval_live import LiveOptions

__all__ = ['Latency', 'LiveScores', 'evaluate_live']


@dataclass(frozen=True)
class Latency:
    """Time from publishing a scan to receiving the answer with its stamp, milliseconds.

    Attributes:
        median_ms, p95_ms, max_ms: Median, 95th percentile and maximum over the answered frames.
    """

    median_ms: float
    p95_ms: float
    max_ms: float


@dataclass(frozen=True)
class LiveScores:
    """The scores of a running stack.

    Attributes:
        task: What was scored: detection, odometry or tracking.
        scores: As the function of that evaluation returns them, such as DetectionScores.
        frames: Number of frames that the stack was sent.
        missing: The numbers of those that it did not answer.
        stragglers: Answers that came after the answer to a later frame.
        latency: Of the answers.
        latencies_ns: By frame, nanoseconds.
        bag: The bag of the results, if it is kept.
        losses: What was not answered or not played, and what could not be scored.
        notes: Other remarks, one line each.
    """

    task: str
    scores: Any
    frames: int
    missing: tuple[int, ...]
    stragglers: int
    latency: Latency
    latencies_ns: Mapping[int, int]
    bag: Path | None
    losses: tuple[Loss, ...]
    notes: tuple[str, ...]


def evaluate_live(source: str | os.PathLike[str], **options: Unpack[LiveKeywords]) -> LiveScores:
    """Play a recording to a stack, score what it says, and measure its latency.

    The player is lossless: it sends a frame when the one before is answered, with /clock. The
    command of `node` runs in a process group of its own and is stopped at the end.

    Args:
        source: A KITTI folder or a bag, with ground truth.
        options: Those of `kitti-ros2 eval live --help`, with the same defaults; topic is required.

    Returns:
        The scores. Each loss is also a KittiRos2Warning.

    Raises:
        KittiRos2Error: The source cannot be played, the stack does not start or answers no frame,
            or its results cannot be scored.
    """
    found = run_live(as_path(source), *make_live_options(by_name(options, LIVE)))
    for loss in found.losses:
        warn(loss.text())
    return found


def run_live(
    source: Path,
    options: LiveOptions,
    played: Mapping[str, object],
    show: Callable[[bytes], object] = lambda _: None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> LiveScores:
    """Do the same with options that are made already.

    Args:
        source: A KITTI folder or a bag.
        options: Those of the run.
        played: Those of the player, by name.
        show: Called with each line of the node's output, from another thread.
        progress: Called with the numbers of answered frames and of all.
    """
    check_installed()
    known = options.known_task()
    if known is not None:
        check_task(known, source, played)

    def accept(msgtype: str) -> None:
        task = options.task_of(msgtype)
        if task != known:
            check_task(task, source, played)

    with ExitStack() as stack:
        if options.out is None:
            folder = stack.enter_context(TemporaryDirectory(prefix='kitti_ros2_'))
            bag = Path(folder) / 'results.mcap'
        else:
            bag = options.out
            refuse_inside(source, bag)
        run = record_run(source, options, played, bag, accept, show, progress)
        task = options.task_of(run.msgtype)
        scores = score_results(task, source, bag, played, run, options.align.value)
    return LiveScores(
        task=task,
        scores=scores,
        frames=len(run.answers.frames()),
        missing=run.missing,
        stragglers=run.answers.stragglers,
        latency=_latency(run.answers.latencies_ns),
        latencies_ns=dict(run.answers.latencies_ns),
        bag=options.out,
        losses=(*run.losses, *scores.losses),
        notes=(*run.notes, *scores.notes),
    )


def _latency(latencies_ns: Mapping[int, int]) -> Latency:
    median, p95, most = np.percentile([*latencies_ns.values()], [50, 95, 100]) / 1e6
    return Latency(float(median), float(p95), float(most))
