# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 recover."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

from ..files.processes import freeze_imports
from ..model.bag_formats import CONTAINERS
from ..model.errors import format_bytes, format_count
from .command import FsyncOption, JsonOption, OverwriteOption, QuietOption, argument, choice
from .exits import EXIT_LOSSES, EXIT_OK
from .output import format_path, print_json, say, say_error, step_progress

if TYPE_CHECKING:
    from ..bags.recover import RecoveryReport


def _summarize(report: RecoveryReport, elapsed: float) -> None:
    for note in report.notes:
        say(f'note: {note}')
    say(
        f'{format_path(report.path)}: {format_count(sum(report.counts.values()), "message")} on'
        f' {format_count(len(report.counts), "topic")}, {format_bytes(report.size_bytes)}; '
        f'{_loss_text(report)}; took {elapsed:.1f} s ({report.size_bytes / elapsed / 1e6:.0f} MB/s)'
    )


def _loss_text(report: RecoveryReport) -> str:
    if report.lost_exactly:
        return f'{format_count(report.lost, "message") if report.lost else "no message"} lost'
    if not report.lost:
        return 'an unknown number of messages lost'
    return f'at least {format_count(report.lost, "message")} lost'


def recover(
    bag: Annotated[Path, argument('BAG', 'A truncated or damaged bag')],
    out: Annotated[Path, argument('OUT', 'The repaired bag, named like OUT of to-bag')],
    storage: Annotated[
        Optional[str],
        choice(CONTAINERS, 'Container of the repaired bag [default: by OUT, else that of BAG]'),
    ] = None,
    overwrite: OverwriteOption = False,
    fsync: FsyncOption = True,
    json: JsonOption = False,
    quiet: QuietOption = False,
) -> int:
    """Repair a truncated or damaged bag; each loss is listed.

    Examples:
      kitti-ros2 recover truncated.mcap repaired.mcap
      kitti-ros2 recover recording.bag repaired --storage mcap
    """
    from ..bags.recover import recover as repair
    from ..files.processes import keep_freed_memory

    freeze_imports()
    keep_freed_memory()
    started = time.monotonic()
    with step_progress('', show=not quiet) as progress:
        report = repair(bag, out, storage, overwrite=overwrite, fsync=fsync, progress=progress)
    elapsed = time.monotonic() - started
    for loss in report.losses:
        say_error(loss)
    if json:
        print_json({**asdict(report), 'seconds': elapsed})
    elif not quiet:
        _summarize(report, elapsed)
    if not report.losses:
        return EXIT_OK
    summary = _loss_text(report)
    if report.lost_exactly and not report.lost:
        summary = 'every message was copied, but the bag is not as a recorder leaves it'
    say_error(f'kitti-ros2: {summary}, listed above; exit code {EXIT_LOSSES}')
    return EXIT_LOSSES
