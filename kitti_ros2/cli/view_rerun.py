# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view --rerun."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from importlib.util import find_spec
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..files.replacing import keep_all, keep_all_but_files
from ..model.errors import UsageError
from ..options.table import make_settings
from .ending import end_by_signal
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .progress import conversion_progress
from .text import complain, format_bytes, format_count, format_path, say

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from ..player.program import Program
    from ..rerun_view.show import ShowReport

_SHOWN_LOSSES = 20
_KEEP_ALL_BUT_RRD = keep_all_but_files('.rrd file', [b'RRF'])
# A page's memory is limited to 4 GB (WebAssembly); Rerun drops data somewhat earlier.
_PAGE_BYTES = 2 << 30


def run_rerun(
    src: Path,
    given: Mapping[str, object],
    *,
    web: bool = False,
    save: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Show a KITTI folder or a bag in Rerun: in its window, on a page for browsers, or in a file.

    Args:
        src: KITTI folder or bag.
        given: Options by name: layout, sequence, start, end and topics, as in to-bag.
        web: Serve a page on localhost until Ctrl-C.
        save: Write this .rrd file.
        overwrite: Whether an existing .rrd file may be replaced.
        quiet: Print only errors and losses.

    Returns:
        The exit code: 1 where something could not be shown.

    Raises:
        UsageError: Rerun is not installed, its viewer does not start, or options exclude others.
        OutputExistsError: The file exists.
        OutputError: The file cannot be written.
    """
    from ..player.source import open_program

    if web and save is not None:
        raise UsageError('--web and --save exclude each other; open the saved file with rerun')
    if save is not None and save.suffix != '.rrd':
        raise UsageError(f'{save}: expected a name that ends in .rrd')
    if find_spec('rerun') is None:
        raise UsageError(
            "--rerun needs rerun-sdk, which is not installed; run pip install 'kitti_ros2[rerun]'"
        )
    # Rerun's log repeats on several lines what is printed here in one.
    os.environ.setdefault('RUST_LOG', 'off')
    settings = make_settings(given)
    with closing(open_program(src, settings)) as program:
        keep_imports()
        if save is not None:
            report = _save(program, save, overwrite=overwrite, quiet=quiet)
        else:
            report = _view(program, web=web, quiet=quiet)
    _show_losses(report)
    return EXIT_LOSSES if report.losses or report.missing else EXIT_OK


def _save(program: Program, path: Path, *, overwrite: bool, quiet: bool) -> ShowReport:
    from ..files.staging import staged_file
    from ..rerun_view.rrd_file import write_file

    refusal = _KEEP_ALL_BUT_RRD if overwrite else keep_all
    with staged_file(path, refusal) as file, _progress(program, quiet=quiet) as progress:
        report = write_file(program, file, progress)
        size_bytes = file.stat().st_size
    if not quiet:
        _summarize(report, f'{format_path(path)}: {format_bytes(size_bytes)}, ')
    return report


def _view(program: Program, *, web: bool, quiet: bool) -> ShowReport:
    from ..rerun_view.viewer import Viewer

    with Viewer(web=web) as viewer:
        if web:
            say(f'{viewer.page}')
            sys.stdout.flush()
        with _progress(program, quiet=quiet) as progress:
            report = viewer.show(program, progress)
        if not quiet:
            _summarize(report, '')
        if web:
            ending = end_by_signal()
            if report.size_bytes > _PAGE_BYTES:
                size = format_bytes(report.size_bytes)
                say(
                    f'note: {size} exceeds the memory of a page, which drops the oldest data;'
                    f' select less with --start, --end or --topics, or use --save'
                )
            if not quiet:
                say('Open the page above in a browser; Ctrl-C ends it.')
            sys.stdout.flush()
            viewer.wait(ending)
    return report


def _progress(
    program: Program, *, quiet: bool
) -> AbstractContextManager[Callable[[int, int], None]]:
    frames = len(set(program.frames.tolist()))
    return conversion_progress(len(program.stamps_ns), frames, show=not quiet)


def _summarize(report: ShowReport, where: str) -> None:
    for note in report.notes:
        say(f'note: {note}')
    say(
        f'{where}{format_count(report.messages, "message")}, {format_count(report.frames, "frame")}'
    )


def _show_losses(report: ShowReport) -> None:
    """Print missing data on standard error."""
    lines = [f'missing: {text}' for text in report.missing]
    lines += [f'skipped ({count}): {text}' for text, count in report.losses.items()]
    for line in lines[:_SHOWN_LOSSES]:
        complain(f'{" ".join(line.split())}')
    if len(lines) > _SHOWN_LOSSES:
        complain(f'and {len(lines) - _SHOWN_LOSSES} more lines like these')
    if lines:
        count = format_count(sum(report.losses.values()), 'message')
        complain(f'kitti-ros2: {count} skipped, listed above; exit code 1')
