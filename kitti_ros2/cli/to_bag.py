# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-bag."""

from __future__ import annotations

import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.processes import freeze_imports
from ..model.bag_formats import FILE_NAMES
from ..model.errors import (
    KeptInterruptError,
    UsageError,
    format_bytes,
    format_count,
    format_duration,
    notes_of,
)
from ..model.streams import Clock
from ..options.messages import Images
from ..options.table import TO_BAG, make_settings, split_batch_options
from .command import JsonOption, QuietOption, add_config, argument, takes
from .output import (
    conversion_progress,
    format_path,
    print_result,
    report_values,
    say,
    step_progress,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from ..model.recording import ReadableRecording
    from ..options.table import BatchOptions, Settings
    from ..own_bags.to_bag import ExportReport


def _run_all(
    src: Path,
    out: Path,
    given: Mapping[str, object],
    settings: Settings,
    batch: BatchOptions,
    *,
    quiet: bool,
    json: bool,
) -> int:
    """Convert a collection."""
    from ..batch.collection import Collection
    from ..batch.job_functions import bag_suffix, run_bag_job
    from ..batch.jobs import find_jobs, find_roots
    from .run_all import refuse_sequence, run_collection

    if given.get('keep_partial'):
        raise UsageError(
            '--keep-partial is for one bag; with --all, the next run converts again what was'
            ' interrupted'
        )
    read = settings.read
    refuse_sequence(read)
    roots = find_roots(src)
    collection = Collection('to-bag', out, bag_suffix(given), given, batch, run_bag_job)
    return run_collection(
        collection,
        lambda search: find_jobs(roots, read.layout, batch.slice_frames, search),
        quiet=quiet,
        json=json,
    )


@contextmanager
def _interruption_described() -> Iterator[None]:
    """Turn Ctrl-C into an error that names partial bags: typer catches KeyboardInterrupt."""
    try:
        yield
    except KeyboardInterrupt as error:
        if not notes_of(error):
            raise
        raise KeptInterruptError('; '.join(notes_of(error))) from error


def _summarize(
    report: ExportReport, elapsed: float, images: Images, recording: ReadableRecording
) -> None:
    written = {topic: count for topic, count in report.counts.items() if count}
    rate = f'{report.frames / elapsed:.0f} frames/s, {report.size_bytes / elapsed / 1e6:.0f} MB/s'
    for note in report.notes:
        say(f'note: {note}')
    timed = recording.clock is not Clock.NOMINAL
    duration = f', {format_duration(report.last_ns - report.first_ns)} of recording' * timed
    say(
        f'{format_path(report.path)}: {format_count(sum(written.values()), "message")} on'
        f' {format_count(len(written), "topic")}, {format_bytes(report.size_bytes)},'
        f' {format_count(report.frames, "frame")}{duration};'
        f' took {elapsed:.1f} s ({rate})'
    )
    if images is Images.COMPRESSED and recording.cameras:
        say('images are the files themselves, PNG or JPEG; --images raw decodes them')


def _start_workers(given: Mapping[str, object]) -> None:
    """Start the workers of a collection: they import while this process does."""
    scheduler = given.get('scheduler')
    alone = str(given.get('jobs')) == '1' and not scheduler
    if given.get('all') and not alone and scheduler in {None, 'local'}:
        from ..batch.pool import prepare_workers

        prepare_workers(cluster=scheduler is not None)


def _convert_bag(
    src: Path,
    out: Path,
    given: Mapping[str, object],
    settings: Settings,
    batch: BatchOptions,
    *,
    quiet: bool,
    json: bool,
) -> int:
    """Write a bag as another."""
    from ..bags.convert import check_options
    from ..bags.convert import convert as convert_bag
    from ..bags.open_source import open_bag_source

    check_options(src, given, batch.jobs)
    started = time.monotonic()
    with (
        open_bag_source(src, whole_chunks=True) as bag,
        step_progress('', show=not quiet) as progress,
        _interruption_described(),
    ):
        report = convert_bag(bag, out, settings, progress)
    elapsed = time.monotonic() - started

    def show() -> None:
        for note in report.notes:
            say(f'note: {note}')
        written = {topic: count for topic, count in report.counts.items() if count}
        say(
            f'{format_path(report.path)}: {format_count(sum(written.values()), "message")} on'
            f' {format_count(len(written), "topic")}, {format_bytes(report.size_bytes)}; took'
            f' {elapsed:.1f} s ({report.size_bytes / elapsed / 1e6:.0f} MB/s)'
        )

    return print_result(
        lambda: {**report_values(report), 'seconds': elapsed},
        show,
        report.losses,
        json=json,
        quiet=quiet,
    )


@takes('TO_BAG_ALL')
def to_bag(
    src: Annotated[
        Path, argument('SRC', 'A KITTI folder: a drive, a data set, a sequence; or a bag')
    ],
    out: Annotated[
        Path,
        argument('OUT', f'The bag: {FILE_NAMES}, or a rosbag2 directory'),
    ],
    config: Annotated[
        Optional[Path],
        typer.Option(metavar='PATH', help='A YAML file of these options; the command line wins'),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write a KITTI recording or a bag to a bag (MCAP, sqlite3, ROS 1).

    A bag of any container is written as OUT names it: messages keep their bytes where they can,
    ROS 1 and ROS 2 become each other, and Foxglove's schemas become messages of ROS. Its options
    are --topics, --exclude-topics, --start, --end, and those of the written bag.

    With --all: every drive, sequence and split below SRC, to OUT/NAME.mcap. A run that was stopped
    goes on where it was; the command status shows what is done.

    Examples:
      kitti-ros2 to-bag 2011_09_26/2011_09_26_drive_0005_sync drive_0005.mcap
      kitti-ros2 to-bag raw bags --all --jobs 4 --exclude-topics '*image*'
    """
    _start_workers(given)
    from ..bags.locate import looks_like_bag
    from ..bags.open_source import open_folder
    from ..files.processes import keep_freed_memory
    from ..files.staging import refuse_inside
    from ..kitti.extract_oxts import add_extract
    from ..kitti.prepare import add_predictions
    from ..own_bags.to_bag import ExportOptions, convert

    freeze_imports()
    batch, given = split_batch_options(given, jobs_alone=True)
    if config:
        given = add_config(config, given, TO_BAG)
    settings = make_settings(given)
    if settings.messages.decodes_images:
        keep_freed_memory()
    if batch.whole:
        return _run_all(src, out, given, settings, batch, quiet=quiet, json=json)
    if settings.read.layout is None and looks_like_bag(src):
        return _convert_bag(src, out, given, settings, batch, quiet=quiet, json=json)
    options = ExportOptions.of(settings, out)
    recording = open_folder(src, settings.read)
    add_predictions(recording, settings.predictions.path)
    add_extract(recording, settings.imu)
    refuse_inside(src, out)
    if settings.read.layout is None and not quiet and not json:
        say(f'{src}: layout {recording.layout.value}, {recording.name}')
    started = time.monotonic()
    with _interruption_described():
        report = convert(
            recording,
            out,
            options,
            progress=partial(conversion_progress, show=not quiet),
            jobs=batch.jobs or 1,
        )
    elapsed = time.monotonic() - started
    named = {'layout': recording.layout.value, 'name': recording.name}
    return print_result(
        lambda: {**named, **report_values(report), 'seconds': elapsed},
        lambda: _summarize(report, elapsed, settings.messages.images, recording),
        report.losses,
        json=json,
        quiet=quiet,
    )
