# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view --rerun."""

from __future__ import annotations

import os
import sys
from contextlib import closing
from typing import TYPE_CHECKING

from ..bag_program import BagProgram
from ..bags.locate import looks_like_bag
from ..bags.staging import Staging, keep_all, reported
from ..errors import UsageError
from ..kitti.layouts import open_recording
from ..program import RecordingProgram
from ..rerun_view.installed import check_installed
from ..settings import make_settings
from .ending import end_by_signal
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_imports
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import AbstractContextManager
    from pathlib import Path

    from ..program import Program
    from ..rerun_view.show import Report

_MOST_WORKERS = 4
_SHOWN_LOSSES = 20
_RRD_MAGIC = b'RRF'
# A page's memory is 4 GB at most (WebAssembly); Rerun begins to drop somewhat before.
_PAGE_BYTES = 2 << 30


def run_rerun(  # noqa: PLR0913 - each is an option of the command
    src: Path,
    *,
    layout: str | None = None,
    sequence: str | None = None,
    start: str | None = None,
    end: str | None = None,
    topics: Sequence[str] = (),
    web: bool = False,
    save: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Show a KITTI folder or a bag in Rerun: in its window, on a page for browsers, or in a file.

    Args:
        src: KITTI folder or bag.
        layout: Of a KITTI folder, None to guess.
        sequence: Which one of a KITTI folder with several.
        start: First moment, as in to-bag.
        end: Last moment, included.
        topics: Only these; * matches.
        web: Serve a page on this machine until Ctrl-C.
        save: Write this .rrd file.
        overwrite: Whether an existing .rrd file may be replaced.
        quiet: Say only what went wrong.

    Returns:
        The exit code: 1 where something could not be shown.

    Raises:
        UsageError: Rerun is not installed, its viewer does not start, or options exclude others.
        OutputExistsError: The file is there already.
        OutputError: It cannot be written.
    """
    if web and save is not None:
        raise UsageError('--web and --save exclude each other; open the saved file with rerun')
    check_installed()
    given = {
        'layout': layout,
        'sequence': sequence,
        'start': start,
        'end': end,
        'topics': tuple(topics) or None,
    }
    # Rerun's own log repeats on several lines what is told here in one.
    os.environ.setdefault('RUST_LOG', 'off')
    with closing(_open(src, given)) as program:
        keep_imports()
        if save is not None:
            report = _save(program, save, overwrite=overwrite, quiet=quiet)
        else:
            report = _view(program, web=web, quiet=quiet)
    _tell_losses(report)
    return EXIT_LOSSES if report.losses or report.missing else EXIT_OK


def _open(src: Path, given: Mapping[str, object]) -> Program:
    if not src.exists():
        raise UsageError(f'{src}: no such file or folder; give a KITTI folder or a bag')
    settings = make_settings({name: value for name, value in given.items() if value is not None})
    if settings.read.layout is None and looks_like_bag(src):
        return BagProgram(src, settings.selection)
    workers = min(_MOST_WORKERS, len(os.sched_getaffinity(0)))
    recording = open_recording(src, settings.read)
    return RecordingProgram(recording, settings.messages, settings.selection, workers)


def _save(program: Program, path: Path, *, overwrite: bool, quiet: bool) -> Report:
    from ..rerun_view.rrd_file import write_file

    place = Staging(path, _keep_all_but_rrd if overwrite else keep_all)
    try:
        with reported(path), _progress(program, quiet=quiet) as progress:
            report = write_file(program, place.content, progress)
        size_bytes = place.content.stat().st_size
        place.publish()
    except BaseException:
        place.discard()
        raise
    if not quiet:
        _summarize(report, f'{format_path(path)}: {format_bytes(size_bytes)}, ')
    return report


def _keep_all_but_rrd(path: Path) -> str | None:
    if path.is_file():
        with path.open('rb') as file:
            head = file.read(len(_RRD_MAGIC))
        if path.suffix == '.rrd' and head in {b'', _RRD_MAGIC}:
            return None
    return 'it is no .rrd file, so --overwrite does not touch it; choose another name'


def _view(program: Program, *, web: bool, quiet: bool) -> Report:
    from ..rerun_view.viewer import Viewer

    with Viewer(web=web) as viewer:
        if web:
            sys.stdout.write(f'{viewer.page}\n')
            sys.stdout.flush()
        with _progress(program, quiet=quiet) as progress:
            report = viewer.show(program, progress)
        if not quiet:
            _summarize(report, '')
        if web:
            ending = end_by_signal()
            if report.size_bytes > _PAGE_BYTES:
                size = format_bytes(report.size_bytes)
                sys.stdout.write(
                    f'note: {size} is more than a page can hold, and it drops the oldest; take'
                    f' less with --start, --end or --topics, or use --save\n'
                )
            if not quiet:
                sys.stdout.write('Open the page above in a browser; Ctrl-C ends it.\n')
            sys.stdout.flush()
            viewer.wait(ending)
    return report


def _progress(
    program: Program, *, quiet: bool
) -> AbstractContextManager[Callable[[int, int], None]]:
    frames = len(set(program.frames.tolist()))
    return conversion_progress(len(program.stamps_ns), frames, show=not quiet)


def _summarize(report: Report, where: str) -> None:
    for note in report.notes:
        sys.stdout.write(f'note: {note}\n')
    sys.stdout.write(
        f'{where}{format_count(report.messages, "message")},'
        f' {format_count(report.frames, "frame")}\n'
    )


def _tell_losses(report: Report) -> None:
    """Name on standard error what is missing."""
    lines = [f'missing: {text}' for text in report.missing]
    lines += [f'skipped ({count}): {text}' for text, count in report.losses.items()]
    for line in lines[:_SHOWN_LOSSES]:
        sys.stderr.write(f'{" ".join(line.split())}\n')
    if len(lines) > _SHOWN_LOSSES:
        sys.stderr.write(f'and {len(lines) - _SHOWN_LOSSES} more lines like these\n')
    if lines:
        count = format_count(sum(report.losses.values()), 'message')
        sys.stderr.write(f'kitti-ros2: {count} skipped, the rest as named above; exit code 1\n')
