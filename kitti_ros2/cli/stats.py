# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stats."""

from __future__ import annotations

import json as json_module
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.processes import freeze_imports
from ..model.errors import BadFileError, UsageError
from ..options.datasets import make_statistics_options
from ..options.table import split_batch_options
from .command import JsonOption, QuietOption, argument, out_option, takes
from .output import (
    PLOTS,
    ResultOutput,
    check_output,
    check_plot,
    format_path,
    print_result,
    say,
    step_progress,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..batch.manifest import JobRecord
    from ..datasets.set_statistics import SetStatistics
    from ..options.table import BatchOptions


def _run_all(
    paths: Sequence[Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Count the content of each job of a collection; print and write the total as a table."""
    from ..batch.collection import Collection
    from ..batch.job_functions import run_statistics_job
    from ..batch.jobs import common_folder, find_all_roots, find_source_jobs
    from ..datasets.set_statistics import SetStatistics, plain_values, write_csv
    from ..files.staging import staged_file
    from .run_all import Combined, output_folder, run_collection
    from .stats_tables import KEEP_ALL_BUT_TABLES, TABLE, print_sets

    read, options = make_statistics_options(given)
    folder = output_folder(read, output.out, PLOTS)
    roots = find_all_roots(paths)
    table = folder / TABLE

    def combine(done: Sequence[tuple[JobRecord, Path]]) -> Combined:
        recordings = tuple(
            replace(recording, name=record.name)
            for record, path in done
            for recording in _read_statistics(path).recordings
        )
        sets = [SetStatistics(common_folder(roots), recordings)] if recordings else []
        with staged_file(table, KEEP_ALL_BUT_TABLES) as path:  # that of an earlier run is replaced
            write_csv(path, sets)

        def show() -> None:
            if sets:
                print_sets(sets, points=options.points)
            say(format_path(table))

        return Combined(
            lambda: {'total': plain_values(sets[0])['total']} if sets else {},
            show,
        )

    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection('stats', folder, '.json', chosen, batch, run_statistics_job)
    return run_collection(
        collection,
        lambda search: find_source_jobs(roots, read.layout, search),
        combine,
        json=output.json,
        quiet=output.quiet,
    )


def _read_statistics(path: Path) -> SetStatistics:
    from ..datasets.set_statistics import read_values

    try:
        return read_values(json_module.loads(path.read_text('utf-8')))
    except (ValueError, TypeError, KeyError) as error:
        raise BadFileError(
            path, f'{error}', 'the statistics of a unit', remedy='remove it, and run again'
        ) from None


@takes('STATS_ALL', of='datasets')
def stats(
    paths: Annotated[list[Path], argument('PATH...', 'Folders or bags; several are compared')],
    out: Annotated[
        Optional[Path], out_option('Picture to draw (.png, .pdf, .svg); a folder with --all')
    ] = None,
    csv: Annotated[
        Optional[Path], typer.Option('--csv', metavar='FILE', help='Table to write, all figures')
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace existing files at OUT and FILE')
    ] = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Count what is in data sets: objects, sensors, routes.

    Classes with difficulty, occlusion, truncation, distance, size, points and tracks; length, speed
    and turn rate of routes; points by SemanticKITTI's class. A folder may hold any number of drives
    and sequences; several folders or bags are compared. With --all: each recording and bag to
    OUT/NAME.json on several processes, then all together, and as a table OUT/statistics.csv.

    Examples:
      kitti-ros2 stats object/training --count-points -o stats.png
      kitti-ros2 stats 2011_09_26 tracking --csv stats.csv
    """
    from ..datasets.set_statistics import count_set, find_sources, plain_values, write_csv
    from ..files.processes import keep_freed_memory
    from ..files.staging import staged_file
    from .stats_tables import KEEP_ALL_BUT_TABLES, TABLE, print_sets, titles_of

    freeze_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options = make_statistics_options(given)
    if batch.whole:
        if csv is not None:
            raise UsageError(f'{csv}: with --all the table is OUT/{TABLE}; leave --csv out')
        output = ResultOutput(out, overwrite, json, quiet)
        return _run_all(paths, given, batch, output)
    write_table = check_output(csv, paths, KEEP_ALL_BUT_TABLES, overwrite=overwrite)
    draw = check_plot(out, paths, overwrite=overwrite)
    sources = [find_sources(path, read) for path in paths]
    with step_progress('counting', show=not quiet) as progress:
        sets = [
            count_set(path, recordings, options, progress)
            for path, recordings in zip(paths, sources, strict=True)
        ]
    if csv is not None:
        with staged_file(csv, write_table) as path:
            write_csv(path, sets)
    if out is not None:
        from ..datasets.statistics_plot import draw_statistics

        with staged_file(out, draw) as path:
            draw_statistics(sets, titles_of(paths), path)

    def show() -> None:
        print_sets(sets, points=options.points)
        for written in (csv, out):
            if written is not None:
                say(format_path(written))

    return print_result(
        lambda: {'sets': [plain_values(data_set) for data_set in sets]},
        show,
        tuple(loss for data_set in sets for loss in data_set.total.losses),
        json=json,
        quiet=quiet,
    )
