# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 crop, and split."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..files.processes import freeze_imports
from ..model.errors import format_bytes, format_count, some_of
from ..options.datasets import make_crop_options, make_split_options
from .command import JsonOption, QuietOption, argument, takes
from .exits import EXIT_LOSSES, EXIT_OK
from .output import (
    format_path,
    print_json,
    print_result,
    report_values,
    say,
    say_error,
    show_losses,
    step_progress,
)

if TYPE_CHECKING:
    from ..datasets.cropping import CroppedRecording, CropReport
    from ..datasets.splitting import SplitReport


# kitti-ros2 crop.


def _summarize(report: CropReport, elapsed: float) -> None:
    for note in report.notes:
        say(f'note: {note}')
    for recording in report.recordings:
        say(f'{format_path(report.path / recording.folder)}: {_points(recording)}')
    linked = sum(recording.linked for recording in report.recordings)
    copied = sum(recording.copied for recording in report.recordings)
    size = format_bytes(sum(recording.size_bytes for recording in report.recordings))
    say(
        f'{format_path(report.path)}: layout {report.layout}, {size} of new files,'
        f' {format_count(linked, "hard link")}, {format_count(copied, "copied file")};'
        f' took {elapsed:.1f} s'
    )


def _points(cut: CroppedRecording) -> str:
    share = 100 * cut.points_after / max(1, cut.points_before)
    dropped = f', {format_count(cut.labels_dropped, "label")} dropped'
    return (
        f'{format_count(cut.scans, "scan")}, {cut.points_after:,} of {cut.points_before:,}'
        f' points ({share:.1f} %){dropped if cut.labels_dropped else ""}'
    )


# kitti-ros2 split.


def _print(report: SplitReport) -> None:
    for part in report.lists:
        entries = format_count(len(part.entries), report.noun)
        of_frames = report.noun == 'frame'
        frames = '' if of_frames else f', {format_count(part.frames, "frame")}'
        drives = f', {format_count(part.drives, "drive")}' if of_frames and part.drives else ''
        share = '' if part.share is None else f' ({100 * part.share:.1f} %)'
        say(f'{format_path(part.path)}: {entries}{frames}{share}{drives}')
    for note in report.notes:
        say(f'note: {note}')
    if report.unlisted:
        count = format_count(len(report.unlisted), report.noun)
        say(f'note: {count} in no list: {some_of(report.unlisted, 5)}')


@takes('CROP', of='datasets')
def crop(
    src: Annotated[Path, argument('SRC', 'A KITTI folder: a drive, split, sequence or whole set')],
    out: Annotated[Path, argument('OUT', 'The folder to create')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Cut scans by view, box, range, height, lasers or voxels.

    OUT is a data set of the same layout, with the same names. All recordings of SRC are cut, or
    the one of --sequence. A point is kept if it passes all filters. Unchanged files are hard links
    to those of SRC: editing one in place changes both.

    Examples:
      kitti-ros2 crop object object_reduced --view reduced --folder velodyne_reduced
      kitti-ros2 crop odometry front --sequence 00 --box 0 -40 -3 70 40 1
    """
    from ..datasets.cropping import crop_sets
    from ..files.processes import keep_freed_memory

    freeze_imports()
    options = make_crop_options(given)
    keep_freed_memory()
    started = time.monotonic()
    with step_progress('cutting scans', show=not (quiet or json)) as progress:
        report = crop_sets(src, out, options, progress)
    elapsed = time.monotonic() - started
    return print_result(
        lambda: {**report_values(report), 'seconds': elapsed},
        lambda: _summarize(report, elapsed),
        report.losses,
        json=json,
        quiet=quiet,
    )


@takes('SPLIT', of='datasets')
def split(
    src: Annotated[Path, argument('SRC', 'A data set: object, tracking, odometry or raw')],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Divide a data set into lists such as train.txt, or check lists.

    Lists of an object set are of frames, of other layouts of whole sequences or drives. The same
    seed makes the same lists on every machine. Frames of one drive look alike: --by-drive keeps
    them in one list. --check exits with 1 where lists overlap or share a drive.

    Examples:
      kitti-ros2 split object --ratio 0.8 0.2 --by-drive
      kitti-ros2 split object --check
    """
    from ..datasets.splitting import split_set

    freeze_imports()
    report = split_set(src, *make_split_options(given))
    if json:
        print_json(report_values(report))
    elif not quiet:
        _print(report)
    for fault in report.faults:
        say_error(fault)
    if report.faults and not report.losses:
        count = format_count(len(report.faults), 'fault')
        say_error(f'kitti-ros2: {count} in the lists, listed above; exit code 1')
    show_losses(report.losses)
    return EXIT_LOSSES if report.faults or report.losses else EXIT_OK
