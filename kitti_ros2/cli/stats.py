# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stats."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..model.errors import UsageError
from ..options.batch import split_batch_options
from ..options.dataset_tables import make_statistics_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import print_json
from .plot_output import check_output, check_plot
from .progress import step_progress
from .text import format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from .result_output import ResultOutput


def run_stats(
    paths: Sequence[Path],
    given: Mapping[str, object],
    output: ResultOutput,
    *,
    table: Path | None,
) -> int:
    """Print the statistics of data sets.

    Args:
        paths: Folders or bags.
        given: The options points, layout and sequence.
        output: Where and how the statistics are put; `out` is the picture to draw.
        table: The CSV file to write, None for none.

    Returns:
        The exit code: 1 where something is missing or damaged.
    """
    from ..datasets.set_statistics import count_set, find_sources
    from ..datasets.statistics_rows import plain_values, write_csv
    from ..files.freed_memory import keep_freed_memory
    from ..files.staging import staged_file
    from .stats_comparison import titles_of
    from .stats_output import KEEP_ALL_BUT_TABLES, TABLE, print_sets

    keep_imports()
    keep_freed_memory()
    batch, given = split_batch_options(given)
    read, options = make_statistics_options(given)
    if batch.whole:
        from .stats_collection import run_statistics_collection

        if table is not None:
            raise UsageError(f'{table}: with --all the table is OUT/{TABLE}; leave --csv out')
        return run_statistics_collection(paths, given, batch, output)
    out = output.out
    write_table = check_output(table, paths, KEEP_ALL_BUT_TABLES, overwrite=output.overwrite)
    draw = check_plot(out, paths, overwrite=output.overwrite)
    sources = [find_sources(path, read) for path in paths]
    with step_progress('counting', show=not output.quiet) as progress:
        sets = [
            count_set(path, found, options, progress)
            for path, found in zip(paths, sources, strict=True)
        ]
    if table is not None:
        with staged_file(table, write_table) as path:
            write_csv(path, sets)
    if out is not None:
        from ..datasets.statistics_plot import draw_statistics

        with staged_file(out, draw) as path:
            draw_statistics(sets, titles_of(paths), path)
    if output.json:
        print_json({'sets': [plain_values(each) for each in sets]})
    elif not output.quiet:
        print_sets(sets, points=options.points)
        for written in (table, out):
            if written is not None:
                say(format_path(written))
    losses = tuple(loss for each in sets for loss in each.total.losses)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK
