# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 download."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..model.errors import UsageError
from ..options.dataset_tables import make_download_options
from .exit_codes import EXIT_INTERRUPTED, EXIT_LOSSES, EXIT_OK
from .extract import say_data_sets
from .json_text import losses_json, print_json
from .progress import bytes_progress
from .text import complain, format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..fetch.download import DownloadReport
    from ..options.fetching import DownloadOptions

_USAGE = 'usage: kitti-ros2 download WHAT... ROOT [OPTIONS]'


def run_download(
    words: Sequence[str], given: dict[str, object], *, listing: bool, json: bool, quiet: bool
) -> int:
    """Download what words name into the folder that is the last of them, or list what there is.

    Returns:
        The exit code.
    """
    from ..fetch.download import download_all, select_entries

    keep_imports()
    options, extraction = make_download_options(given)
    if listing:
        return _list(words, options, json=json)
    what, root = _split(words, options)
    entries = select_entries(what, options)
    try:
        with bytes_progress('downloading', 'extracting', show=not quiet) as (fetching, extracting):
            progress = fetching, extracting
            report = download_all(entries, root, options, extraction, progress)
    except KeyboardInterrupt:
        complain('kitti-ros2: interrupted; what was downloaded is kept, run it again to go on')
        sys.exit(EXIT_INTERRUPTED)
    show_losses(report.losses)
    if json:
        print_json({**asdict(report), 'losses': losses_json(report.losses)})
    elif not quiet:
        _say(report)
    return EXIT_LOSSES if report.losses else EXIT_OK


def _split(words: Sequence[str], options: DownloadOptions) -> tuple[Sequence[str], Path]:
    """Split the words into what to download and where to."""
    from ..fetch.download import select_entries

    if not words:
        raise UsageError(
            f'WHAT is missing (such as raw 2011_09_26_drive_0005, or object calib); {_USAGE};'
            f' --list shows what there is'
        )
    *what, last = words
    if '/' not in last and not Path(last).exists():
        try:
            select_entries(words, options)
        except UsageError:
            pass
        else:
            raise UsageError(f'ROOT is missing (the folder to download into); {_USAGE}')
    return what, Path(last)


def _say(report: DownloadReport) -> None:
    for note in report.notes:
        say(f'note: {note}')
    files = sum(each.written for each in report.extracted)
    size = sum(each.size_bytes for each in report.extracted)
    existing = f', {len(report.existing)} there before' if report.existing else ''
    say(
        f'{format_path(report.root)}: {format_count(len(report.downloaded), "archive")}'
        f' downloaded{existing}; {format_count(files, "file")} extracted, {format_bytes(size)}'
    )
    for folder in report.folders:
        say_data_sets(folder)


# The list.


def _list(words: Sequence[str], options: DownloadOptions, *, json: bool) -> int:
    """Print the archives and drives of benchmarks, all without words."""
    from ..fetch.catalogue import BENCHMARKS, ENTRIES
    from ..fetch.raw_drives import raw_drives

    for word in words:
        if word not in BENCHMARKS:
            raise UsageError(f'--list takes {" ".join(BENCHMARKS)}, not {word}')
    chosen = words or BENCHMARKS
    entries = [each for each in ENTRIES if each.benchmark in chosen]
    drives = [
        each
        for each in raw_drives().values()
        if 'raw' in chosen and each.category in (options.categories or (each.category,))
    ]
    if json:
        archives = [{**asdict(each), 'size_bytes': each.about_bytes} for each in entries]
        print_json({'archives': archives, 'drives': [asdict(each) for each in drives]})
        return EXIT_OK
    rows = [(each.benchmark, each.part, _about(each.about_bytes), each.name) for each in entries]
    _print_table(('benchmark', 'part', 'size', 'archive'), rows)
    if drives:
        sys.stdout.write('\n')
        _print_table(
            ('raw drive', 'category', 'frames', 'size', 'tracklets'),
            [
                (
                    each.name,
                    each.category,
                    '-' if each.frames is None else str(each.frames),
                    format_bytes(each.sync_bytes),
                    'yes' if each.has_tracklets else '-',
                )
                for each in drives
            ],
        )
    return EXIT_OK


def _about(size: int | None) -> str:
    return '-' if size is None else format_bytes(size).replace('.0 ', ' ')


def _print_table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    for row in (heads, *rows):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write('  '.join(cells).rstrip() + '\n')
