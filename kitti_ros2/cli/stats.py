# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from ..files.processes import keep_imports
from ..model.errors import UsageError
from ..options.datasets import make_statistics_options
from ..options.table import split_batch_options
from .command import JsonOption, QuietOption, argument, out_option, takes
from .output import (
    ResultOutput,
    check_output,
    check_plot,
    format_path,
    put_result,
    say,
    step_progress,
)


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
      kitti-ros2 stats object/training --points -o stats.png
      kitti-ros2 stats 2011_09_26 tracking --csv stats.csv
    """
    from ..datasets.set_statistics import count_set, find_sources, plain_values, write_csv
    from ..files.processes import keep_freed_memory
    from ..files.staging import staged_file
    from .stats_tables import KEEP_ALL_BUT_TABLES, TABLE, print_sets, titles_of

    keep_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options = make_statistics_options(given)
    if batch.whole:
        from .collection import run_statistics_collection

        if csv is not None:
            raise UsageError(f'{csv}: with --all the table is OUT/{TABLE}; leave --csv out')
        output = ResultOutput(out, overwrite, json, quiet)
        return run_statistics_collection(paths, given, batch, output)
    write_table = check_output(csv, paths, KEEP_ALL_BUT_TABLES, overwrite=overwrite)
    draw = check_plot(out, paths, overwrite=overwrite)
    sources = [find_sources(path, read) for path in paths]
    with step_progress('counting', show=not quiet) as progress:
        sets = [
            count_set(path, found, options, progress)
            for path, found in zip(paths, sources, strict=True)
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

    return put_result(
        lambda: {'sets': [plain_values(each) for each in sets]},
        show,
        tuple(loss for each in sets for loss in each.total.losses),
        json=json,
        quiet=quiet,
    )
