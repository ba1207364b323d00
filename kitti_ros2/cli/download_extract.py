# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 download, and extract."""

from __future__ import annotations

import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.processes import freeze_imports
from ..model.errors import UsageError, format_bytes, format_count
from ..options.datasets import make_download_options, make_extract_options
from .command import JsonOption, QuietOption, takes
from .exits import EXIT_INTERRUPTED, EXIT_OK
from .output import (
    bytes_progress,
    format_path,
    print_json,
    print_result,
    report_values,
    say,
    say_error,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..datasets.downloading import DownloadReport
    from ..datasets.extracting import ExtractReport
    from ..options.datasets import DownloadOptions


# kitti-ros2 extract.

_MOST_NAMED = 3


def say_extracted(report: ExtractReport) -> None:
    """Print what was extracted, and the commands that show it."""
    for note in report.notes:
        say(f'note: {note}')
    for archive in report.archives:
        equal = f', {format_count(archive.kept, "file")} kept as equal' if archive.kept else ''
        removed = '; archive removed' if archive.removed else ''
        say(
            f'{format_path(archive.path)}: {format_count(archive.written, "file")} written,'
            f' {format_bytes(archive.size_bytes)}{equal}{removed}'
        )
    say_data_sets(report.root)


def say_data_sets(root: Path) -> None:
    """Print the commands that show the data sets in a folder, if they are few."""
    from ..kitti.opening import data_sets_below, data_sets_in

    # Without folders of their own: in the folders of KITTI-360 are parts of its drives.
    whole = [data for data in data_sets_in(root) if data.recordings[0].folder is None]
    below, complete = data_sets_below(root, whole)
    if complete and len(whole + below) <= _MOST_NAMED:
        for data_set in whole + below:
            say(f'next: kitti-ros2 info {shlex.quote(format_path(data_set.folder))}')


# kitti-ros2 download.

_USAGE = 'usage: kitti-ros2 download WHAT... ROOT [OPTIONS]'


def _split(words: Sequence[str], options: DownloadOptions) -> tuple[Sequence[str], Path]:
    """Split the words into what to download and where to."""
    from ..datasets.downloading import select_entries

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


def _summarize(report: DownloadReport) -> None:
    for note in report.notes:
        say(f'note: {note}')
    files = sum(archive.written for archive in report.extracted)
    size = sum(archive.size_bytes for archive in report.extracted)
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
    from ..datasets.catalogue import BENCHMARKS, ENTRIES, raw_drives

    for word in words:
        if word not in BENCHMARKS:
            raise UsageError(f'--list takes {" ".join(BENCHMARKS)}, not {word}')
    chosen = words or BENCHMARKS
    entries = [entry for entry in ENTRIES if entry.benchmark in chosen]
    drives = [
        drive
        for drive in raw_drives().values()
        if 'raw' in chosen and drive.category in (options.categories or (drive.category,))
    ]
    if json:
        archives = [{**asdict(entry), 'size_bytes': entry.about_bytes} for entry in entries]
        print_json({'archives': archives, 'drives': [asdict(drive) for drive in drives]})
        return EXIT_OK
    rows = [
        (entry.benchmark, entry.part, _about(entry.about_bytes), entry.name) for entry in entries
    ]
    _print_table(('benchmark', 'part', 'size', 'archive'), rows)
    if drives:
        sys.stdout.write('\n')
        _print_table(
            ('raw drive', 'category', 'frames', 'size', 'tracklets'),
            [
                (
                    drive.name,
                    drive.category,
                    '-' if drive.frames is None else str(drive.frames),
                    format_bytes(drive.sync_bytes),
                    'yes' if drive.has_tracklets else '-',
                )
                for drive in drives
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


@takes('DOWNLOAD', of='datasets')
def download(
    words: Annotated[
        Optional[list[str]],
        typer.Argument(
            metavar='WHAT... ROOT',
            help='A benchmark with its parts, or raw drives; then the folder to download into',
        ),
    ] = None,
    list_: Annotated[
        bool, typer.Option('--list', help='List what there is, with sizes, and stop; no ROOT')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Download KITTI's archives by name and extract them.

    WHAT: object, tracking or odometry with parts (image_2, calib, ... or all); raw with drives
    (2011_09_26_drive_0005), ranges (2011_09_26_drive_0001..0017), days (2011_09_26) or all. Drives
    come with the calibration of their day. An interrupted run goes on.

    Examples:
      kitti-ros2 download raw 2011_09_26_drive_0005 kitti --accept-license
      kitti-ros2 download object velodyne calib label_2 kitti
    """
    from ..datasets.downloading import download_all, select_entries

    freeze_imports()
    words = words or []
    options, extraction = make_download_options(given)
    if list_:
        return _list(words, options, json=json)
    what, root = _split(words, options)
    entries = select_entries(what, options)
    try:
        with bytes_progress('downloading', 'extracting', show=not quiet) as (fetching, extracting):
            progress = fetching, extracting
            report = download_all(entries, root, options, extraction, progress)
    except KeyboardInterrupt:
        say_error('kitti-ros2: interrupted; what was downloaded is kept, run it again to go on')
        sys.exit(EXIT_INTERRUPTED)
    return print_result(
        lambda: report_values(report),
        lambda: _summarize(report),
        report.losses,
        json=json,
        quiet=quiet,
    )


@takes('EXTRACT', of='datasets')
def extract(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='ARCHIVE... ROOT',
            help='Zip or tar archives, then the folder to extract them into',
        ),
    ],
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Extract KITTI's archives into the folders that readers expect.

    Each file goes where its known folders belong (2011_09_26/..., training/..., dataset/...),
    whatever the archive has above them. Equal files are kept: an interrupted run goes on.

    Examples:
      kitti-ros2 extract 2011_09_26_drive_0005_sync.zip 2011_09_26_calib.zip kitti
      kitti-ros2 extract downloads/data_object_calib.zip object --remove-archives
    """
    from ..datasets.extracting import extract_all
    from ..kitti.archives import is_archive

    freeze_imports()
    *archives, root = paths
    if is_archive(root.name) and (root.is_file() or not archives):
        raise UsageError(
            f'{root}: ROOT is missing (the folder to extract into);'
            f' usage: kitti-ros2 extract ARCHIVE... ROOT [OPTIONS]'
        )
    options = make_extract_options(given)
    with bytes_progress('extracting', show=not quiet) as (progress,):
        report = extract_all(archives, root, options, progress)
    return print_result(
        lambda: report_values(report),
        lambda: say_extracted(report),
        report.losses,
        json=json,
        quiet=quiet,
    )
