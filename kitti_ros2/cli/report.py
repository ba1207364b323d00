# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 report."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..files.replacing import KEEP_ALL_BUT_PAGES, keep_all
from ..model.errors import UsageError
from ..options.batch import split_batch_options
from ..options.eval_detection import DetectionOptions
from ..options.table import make_settings
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .page_output import ENDINGS, open_page
from .progress import step_progress
from .text import complain, format_bytes, format_count, format_path, say

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from ..evaluation.detection import DetectionScores
    from ..options.read import ReadOptions


def run_report(
    src: Path,
    out: Path,
    given: Mapping[str, object],
    *,
    results: Path | None = None,
    overwrite: bool,
    quiet: bool,
    show: bool = False,
) -> int:
    """Write the report of a KITTI folder or a bag.

    Args:
        src: The folder or the bag.
        out: The page; with --all the folder of pages.
        given: The options layout and sequence.
        results: Results of a detector to score, None for none.
        overwrite: Whether an existing page may be replaced.
        quiet: Print only losses.
        show: Whether to open the page in the browser.

    Returns:
        The exit code: 1 where something is missing or damaged.
    """
    from ..files.freed_memory import keep_freed_memory
    from ..files.staging import Staging, staged_file
    from ..report.gather import gather, with_scores
    from ..report.page import make_page

    keep_imports()
    keep_freed_memory()
    started = time.monotonic()
    batch, given = split_batch_options(given)
    if batch.whole:
        from .report_collection import run_report_collection

        chosen = {**given, 'overwrite': overwrite}
        return run_report_collection(
            src, out, chosen, batch, results=results, quiet=quiet, show=show
        )
    options = make_settings(given).read
    if out.suffix.lower() not in ENDINGS:
        raise UsageError(f'{out}: a report is an HTML page; expected a name that ends in .html')
    refusal = KEEP_ALL_BUT_PAGES if overwrite else keep_all
    Staging(out, refusal).discard()  # raises now for what could not be written later
    with step_progress('reading', show=not quiet) as progress:
        scores = None if results is None else _score(src, results, options)
        report = gather(src, options, progress)
        if scores is not None:
            report = with_scores(report, scores)
    with staged_file(out, refusal) as path:
        size = path.write_bytes(make_page(report).encode())
    for finding in report.findings:
        if finding.is_loss:
            complain(f'{finding.where + ": " if finding.where else ""}{finding.text}')
    if not quiet:
        notes = f', {format_count(report.notes, "note")}' if report.notes else ''
        say(
            f'{format_path(out)}: {report.verdict}{notes};'
            f' {format_bytes(size)}, took {time.monotonic() - started:.1f} s'
        )
    if show:
        open_page(out)
    if report.sound:
        return EXIT_OK
    complain(f'kitti-ros2: data is missing or damaged, listed above; exit code {EXIT_LOSSES}')
    return EXIT_LOSSES


def _score(src: Path, results: Path, options: ReadOptions) -> DetectionScores:
    from ..evaluation.detection import score_paths
    from ..options.bag_results import BagResultsOptions

    return score_paths(src, results, options, DetectionOptions(), BagResultsOptions())
