# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.output_rules import KEEP_ALL_BUT_PAGES, refusal_of
from ..files.processes import freeze_imports
from ..model.errors import UsageError, format_bytes, format_count
from ..options.evaluation import DetectionOptions
from ..options.table import make_settings, split_batch_options
from .command import OverwriteOption, QuietOption, argument, out_option, takes
from .exits import EXIT_LOSSES, EXIT_OK
from .output import ENDINGS, ResultOutput, format_path, open_page, say, say_error, step_progress

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..batch.jobs import FolderSearch, Job
    from ..batch.manifest import JobRecord
    from ..evaluation.detection import DetectionScores
    from ..options.read import ReadOptions
    from ..options.table import BatchOptions

_SUFFIX = '.html'
_INDEX = 'index'


def _score(src: Path, results: Path, options: ReadOptions) -> DetectionScores:
    from ..evaluation.detection import score_detection
    from ..options.evaluation import BagResultsOptions

    return score_detection(src, results, options, DetectionOptions(), BagResultsOptions())


def _run_all(
    src: Path,
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
    *,
    results: Path | None,
    show: bool,
) -> int:
    """Write a page for each recording and bag of a collection, and an index of them."""
    from ..batch.collection import Collection
    from ..batch.job_functions import run_report_job
    from ..batch.jobs import common_folder, find_all_roots, find_source_jobs
    from ..files.staging import staged_file
    from ..report.page import IndexEntry, make_index
    from .run_all import Combined, output_folder, refuse_sequence, run_collection

    read = make_settings(given).read
    refuse_sequence(read)
    if results is not None:
        raise UsageError(f'{results}: --predictions scores one recording; leave out --all')
    folder = output_folder(read, output.out, ENDINGS)
    roots = find_all_roots([src])
    index = folder / f'{_INDEX}{_SUFFIX}'

    def find(search: FolderSearch) -> list[Job]:
        jobs = find_source_jobs(roots, read.layout, search)
        hidden = [job.source for job in jobs if job.name == _INDEX]
        if hidden:
            raise UsageError(f'{hidden[0]}: its page would be {index}, that of all; rename it')
        return jobs

    def combine(done: Sequence[tuple[JobRecord, Path]]) -> Combined:
        entries = [
            IndexEntry(
                record.name, path.relative_to(folder), record.counts.get('frames', 0), record.bad
            )
            for record, path in done
        ]
        with staged_file(index, KEEP_ALL_BUT_PAGES) as path:
            path.write_bytes(make_index(str(common_folder(roots)), entries).encode())
        return Combined(show=lambda: say(format_path(index)))

    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection('report', folder, _SUFFIX, chosen, batch, run_report_job)
    code = run_collection(collection, find, combine, quiet=output.quiet)
    if show:
        open_page(index)
    return code


@takes('REPORT_ALL')
def report(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    out: Annotated[Path, out_option('The page to write; with --all a folder of pages')] = Path(
        'report.html'
    ),
    results: Annotated[
        Optional[Path],
        typer.Option('--predictions', metavar='PATH', help='Result files of a detector, to score'),
    ] = None,
    show: Annotated[bool, typer.Option('--open', help='Open the page in the browser')] = False,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write an HTML report on a KITTI folder or a bag.

    One self-contained file: findings, frames in pictures, streams with gaps and jitter, route,
    objects, calibration. With --all: a page for each recording and bag below SRC, and an index.

    Examples:
      kitti-ros2 report 2011_09_26/2011_09_26_drive_0005_sync --open
      kitti-ros2 report drive_0005.mcap -o drive_0005.html
    """
    from ..files.local_staging import Staging
    from ..files.processes import keep_freed_memory
    from ..files.staging import staged_file
    from ..report.gather import gather, with_scores
    from ..report.page import make_page

    freeze_imports()
    keep_freed_memory()
    started = time.monotonic()
    batch, given = split_batch_options(given)
    if batch.whole:
        output = ResultOutput(out, overwrite, json=False, quiet=quiet)
        return _run_all(src, given, batch, output, results=results, show=show)
    options = make_settings(given).read
    if out.suffix.lower() not in ENDINGS:
        raise UsageError(f'{out}: a report is an HTML page; expected a name that ends in .html')
    refusal = refusal_of(KEEP_ALL_BUT_PAGES, overwrite=overwrite)
    Staging(out, refusal).discard()  # raises now for what could not be written later
    with step_progress('reading', show=not quiet) as progress:
        scores = None if results is None else _score(src, results, options)
        page = gather(src, options, progress)
        if scores is not None:
            page = with_scores(page, scores)
    with staged_file(out, refusal) as path:
        size = path.write_bytes(make_page(page).encode())
    for issue in page.issues:
        if issue.is_loss:
            say_error(f'{issue.where + ": " if issue.where else ""}{issue.text}')
    if not quiet:
        notes = f', {format_count(page.notes, "note")}' if page.notes else ''
        say(
            f'{format_path(out)}: {page.verdict}{notes};'
            f' {format_bytes(size)}, took {time.monotonic() - started:.1f} s'
        )
    if show:
        open_page(out)
    if page.sound:
        return EXIT_OK
    say_error(f'kitti-ros2: data is missing or damaged, listed above; exit code {EXIT_LOSSES}')
    return EXIT_LOSSES
