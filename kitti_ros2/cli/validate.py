# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 validate."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from ..files.processes import freeze_imports
from ..model.errors import format_bytes, format_count, one_line
from ..options.datasets import make_validation_options
from ..options.table import split_batch_options
from .command import AllOverwriteOption, JsonOption, QuietOption, out_option, takes
from .exits import EXIT_LOSSES, EXIT_OK
from .output import (
    ResultOutput,
    console,
    format_path,
    print_json,
    refuse_files,
    say_error,
    step_progress,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..options.table import BatchOptions
    from ..validation.rule import RuleFindings, ValidationReport

_SHOWN_PER_RULE = 3
_SHOWN_SOURCES = 12
_SHOWN_ERRORS = 20
_STYLES = {'error': 'bold red', 'warning': 'yellow', 'note': 'dim'}


def _run_all(
    paths: Sequence[Path],
    given: Mapping[str, object],
    batch: BatchOptions,
    output: ResultOutput,
) -> int:
    """Check the recordings and bags of a collection."""
    from ..batch.collection import Collection
    from ..batch.job_functions import run_validation_job
    from ..batch.jobs import find_all_roots, find_source_jobs
    from .run_all import output_folder, run_collection

    read, _ = make_validation_options(given)
    folder = output_folder(read, output.out, ['.json'])
    roots = find_all_roots(paths)
    chosen = {**given, 'overwrite': output.overwrite}
    collection = Collection('validate', folder, '.json', chosen, batch, run_validation_job)
    return run_collection(
        collection,
        lambda search: find_source_jobs(roots, read.layout, search),
        quiet=output.quiet,
        json=output.json,
    )


def _print_report(report: ValidationReport, elapsed: float) -> None:
    """Print sources, and the findings by rule, for a terminal of 80 columns."""
    screen = console(soft_wrap=True)
    for source in report.sources[:_SHOWN_SOURCES]:
        noun = 'message' if source.is_bag else 'frame'
        parts = [format_count(source.count, noun), format_count(source.files, 'file')]
        name = '' if source.name == source.path.name else f' {source.name}'  # of shared folders
        line = f'{format_path(source.path)}  {source.kind}{name}: {", ".join(parts)}'
        screen.print(one_line(line), style='bold', markup=False)
    if len(report.sources) > _SHOWN_SOURCES:
        screen.print(f'... and {len(report.sources) - _SHOWN_SOURCES} more', markup=False)
    for group in report.rules:
        screen.print()
        _print_group(screen, group)
    screen.print()
    size = sum(source.size_bytes for source in report.sources)
    files = sum(source.files for source in report.sources)
    screen.print(
        f'{_count(report)} in {format_count(files, "file")}, {format_bytes(size)};'
        f' took {elapsed:.1f} s ({size / elapsed / 1e6:.0f} MB/s)',
        markup=False,
    )


def _print_group(screen: Any, group: RuleFindings) -> None:  # noqa: ANN401 - rich's console
    head = f'{group.severity} {group.rule} ({group.count:,}): {group.checks}'
    screen.print(one_line(head), style=_STYLES[group.severity], markup=False)
    for finding in group.findings[:_SHOWN_PER_RULE]:
        line = '' if finding.line is None else f':{finding.line}'
        location = f'{format_path(finding.path)}{line}'
        screen.print('  ' + one_line(f'{location}: {finding.message}'), markup=False)
    if group.count > _SHOWN_PER_RULE:
        screen.print(f'  ... and {group.count - _SHOWN_PER_RULE:,} more', markup=False)
    screen.print(f'  -> {group.remedy}', markup=False)


def _print_errors(report: ValidationReport) -> None:
    errors = [finding for finding in report.findings if finding.severity == 'error']
    for error in errors[:_SHOWN_ERRORS]:
        say_error(f'error {error.rule}: {error.place}: {error.message} ({error.remedy})')
    if report.errors > _SHOWN_ERRORS:
        say_error(f'... and {report.errors - _SHOWN_ERRORS:,} more; --json lists them')


def _count(report: ValidationReport) -> str:
    counts = (report.errors, 'error'), (report.warnings, 'warning'), (report.notes, 'note')
    return ', '.join(format_count(count, noun) for count, noun in counts)


@takes('VALIDATE_ALL', of='datasets')
def validate(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar='PATH...', help='KITTI folders, folders of several, or bags'),
    ],
    out: Annotated[Optional[Path], out_option('With --all: folder of findings as JSON')] = None,
    overwrite: AllOverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Check every file of KITTI folders and bags.

    All drives, sequences and splits at PATH and below are checked. Errors (exit code 1) are wrong
    or unreadable data, warnings suspicious or missing data. Findings have file, line and remedy.
    With --all: each recording and bag on its own, to OUT/NAME.json, on several processes.

    Examples:
      kitti-ros2 validate object
      kitti-ros2 validate 2011_09_26 drive_0005.mcap --json
    """
    from ..files.processes import keep_freed_memory
    from ..validation.validate import validate as check

    freeze_imports()
    keep_freed_memory()
    batch, options = split_batch_options(given)
    if batch.whole:
        output = ResultOutput(out, overwrite, json, quiet)
        return _run_all(paths, options, batch, output)
    refuse_files(out, overwrite=overwrite)
    started = time.monotonic()
    with step_progress('', show=not quiet) as progress:
        report = check(paths, progress=progress, **options)  # type: ignore[arg-type] # checked
    elapsed = time.monotonic() - started
    if json:
        print_json({**asdict(report), 'ok': report.ok, 'seconds': elapsed})
    elif not quiet:
        _print_report(report, elapsed)
    if report.ok:
        return EXIT_OK
    if quiet:
        _print_errors(report)
    say_error(f'kitti-ros2: {_count(report)}; exit code {EXIT_LOSSES}')
    return EXIT_LOSSES
