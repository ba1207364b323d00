# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 split."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..model.text import some_of
from ..options.dataset_tables import make_split_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .text import complain, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..datasets.splitting import SplitReport


def run_split(src: Path, given: Mapping[str, object], *, json: bool, quiet: bool) -> int:
    """Divide a data set, or check its lists, and print the lists.

    Args:
        src: The set.
        given: Options by name.
        json: Whether to print the lists as JSON.
        quiet: Print only faults and losses.

    Returns:
        The exit code: 1 if lists overlap or contain what cannot be used.
    """
    from ..datasets.splitting import split_set

    keep_imports()
    report = split_set(src, *make_split_options(given))
    if json:
        print_json({**asdict(report), 'losses': losses_json(report.losses)})
    elif not quiet:
        _print(report)
    for fault in report.faults:
        complain(fault)
    if report.faults and not report.losses:
        count = format_count(len(report.faults), 'fault')
        complain(f'kitti-ros2: {count} in the lists, listed above; exit code 1')
    show_losses(report.losses)
    return EXIT_LOSSES if report.faults or report.losses else EXIT_OK


def _print(report: SplitReport) -> None:
    for each in report.lists:
        entries = format_count(len(each.entries), report.noun)
        of_frames = report.noun == 'frame'
        frames = '' if of_frames else f', {format_count(each.frames, "frame")}'
        drives = f', {format_count(each.drives, "drive")}' if of_frames and each.drives else ''
        share = '' if each.share is None else f' ({100 * each.share:.1f} %)'
        say(f'{format_path(each.path)}: {entries}{frames}{share}{drives}')
    for note in report.notes:
        say(f'note: {note}')
    if report.unlisted:
        count = format_count(len(report.unlisted), report.noun)
        say(f'note: {count} in no list: {some_of(report.unlisted, 5)}')
