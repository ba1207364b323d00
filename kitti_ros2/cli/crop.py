# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 crop."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..options.dataset_tables import make_crop_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .progress import step_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..datasets.cropping import CropReport
    from ..datasets.recording_crop import CroppedRecording


def run_crop(src: Path, out: Path, given: Mapping[str, object], *, json: bool, quiet: bool) -> int:
    """Cut the scans of a KITTI folder and print a summary.

    Args:
        src: The folder.
        out: The folder to create.
        given: Options by name.
        json: Whether to print the summary as JSON.
        quiet: Print only losses.

    Returns:
        The exit code: 1 if something could not be cut or placed.
    """
    from ..datasets.cropping import crop_sets
    from ..files.freed_memory import keep_freed_memory

    keep_imports()
    options = make_crop_options(given)
    keep_freed_memory()
    started = time.monotonic()
    with step_progress('cutting scans', show=not (quiet or json)) as progress:
        report = crop_sets(src, out, options, progress)
    elapsed = time.monotonic() - started
    if json:
        values = {**asdict(report), 'losses': losses_json(report.losses), 'seconds': elapsed}
        print_json(values)
    elif not quiet:
        _summarize(report, elapsed)
    show_losses(report.losses)
    return EXIT_LOSSES if report.losses else EXIT_OK


def _summarize(report: CropReport, elapsed: float) -> None:
    for note in report.notes:
        say(f'note: {note}')
    for each in report.recordings:
        say(f'{format_path(report.path / each.folder)}: {_points(each)}')
    linked = sum(each.linked for each in report.recordings)
    copied = sum(each.copied for each in report.recordings)
    size = format_bytes(sum(each.size_bytes for each in report.recordings))
    say(
        f'{format_path(report.path)}: layout {report.layout}, {size} of new files,'
        f' {format_count(linked, "hard link")}, {format_count(copied, "copied file")};'
        f' took {elapsed:.1f} s'
    )


def _points(each: CroppedRecording) -> str:
    share = 100 * each.points_after / max(1, each.points_before)
    dropped = f', {format_count(each.labels_dropped, "label")} dropped'
    return (
        f'{format_count(each.scans, "scan")}, {each.points_after:,} of {each.points_before:,}'
        f' points ({share:.1f} %){dropped if each.labels_dropped else ""}'
    )
