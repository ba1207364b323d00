# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 extract."""

from __future__ import annotations

import shlex
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..files.kept_imports import keep_imports
from ..model.errors import UsageError
from ..options.dataset_tables import make_extract_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .progress import bytes_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from pathlib import Path

    from ..fetch.extract import ExtractReport

_MOST_NAMED = 3


def run_extract(paths: list[Path], given: dict[str, object], *, json: bool, quiet: bool) -> int:
    """Extract archives into the last path and report what was written.

    Returns:
        The exit code.
    """
    from ..fetch.extract import extract_all
    from ..kitti.archives import is_archive

    keep_imports()
    *archives, root = paths
    if is_archive(root.name) and (root.is_file() or not archives):
        raise UsageError(
            f'{root}: ROOT is missing (the folder to extract into);'
            f' usage: kitti-ros2 extract ARCHIVE... ROOT [OPTIONS]'
        )
    options = make_extract_options(given)
    with bytes_progress('extracting', show=not quiet) as (progress,):
        report = extract_all(archives, root, options, progress)
    show_losses(report.losses)
    if json:
        print_json(report_json(report))
    elif not quiet:
        say_extracted(report)
    return EXIT_LOSSES if report.losses else EXIT_OK


def report_json(report: ExtractReport) -> dict[str, Any]:
    """Return a report for print_json."""
    return {**asdict(report), 'losses': losses_json(report.losses)}


def say_extracted(report: ExtractReport) -> None:
    """Print what was extracted, and the commands that show it."""
    for note in report.notes:
        say(f'note: {note}')
    for each in report.archives:
        kept = f', {format_count(each.kept, "file")} kept as equal' if each.kept else ''
        removed = '; archive removed' if each.removed else ''
        say(
            f'{format_path(each.path)}: {format_count(each.written, "file")} written,'
            f' {format_bytes(each.size_bytes)}{kept}{removed}'
        )
    say_data_sets(report.root)


def say_data_sets(root: Path) -> None:
    """Print the commands that show the data sets in a folder, if they are few."""
    from ..kitti.nearby import data_sets_below

    found, complete = data_sets_below(root)
    if complete and len(found) <= _MOST_NAMED:
        for data_set in found:
            say(f'next: kitti-ros2 info {shlex.quote(format_path(data_set.folder))}')
