# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from ..files.kept_imports import keep_imports
from ..model.errors import UsageError
from ..options.batch import split_batch_options
from ..options.table import make_import_options
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .plan_look import (
    PlanRequest,
    check_preview,
    drawn_values,
    print_look,
    print_table,
    say_drawn,
    see,
)
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..importer.report import ImportReport
    from ..options.batch import BatchOptions
    from ..options.importing import ImportOptions


_NO_OUT = 'OUT is missing (the folder to create)'
_YAML = {'.yaml', '.yml'}


def run_to_kitti(
    paths: Sequence[Path],
    given: Mapping[str, Any],
    plan_file: Path | None,
    *,
    plan_only: bool,
    preview: Path | None = None,
    quiet: bool,
    json: bool = False,
) -> int:
    """Convert and print a summary; or show the plan, or what it makes of three frames.

    Args:
        paths: Bags, and the output last; without an output the plan is shown on a terminal.
        given: Options by name.
        plan_file: A plan to use.
        plan_only: Whether to print the plan as YAML and stop.
        preview: A picture of three frames to write first.
        quiet: Print only losses.
        json: Whether to print the summary, or the plan, as JSON.

    Returns:
        The exit code.

    Raises:
        UsageError: The arguments are invalid.
    """
    from ..files.freed_memory import keep_freed_memory
    from ..files.staging import refuse_inside
    from ..own_bags.to_kitti import is_restored, own_bags

    keep_imports()
    batch, given = split_batch_options(given)
    options = make_import_options(given)
    if batch.whole:
        if plan_only or preview is not None:
            raise UsageError(
                '--plan and --preview look at the bags of one recording; leave out --all'
            )
        return _run_whole(paths, given, options, plan_file, batch, quiet=quiet, json=json)
    if plan_only:
        if options.overwrite or not options.selection.is_whole or json or preview is not None:
            raise UsageError(
                '--plan prints the plan of all frames, as YAML; give --start, --end, --overwrite'
                ' and --json with the conversion, and --preview without --plan'
            )
        _check_plan_only(paths, plan_file)
        return _print_plan(paths, options)
    shown = sys.stdout.isatty() and not (quiet or json)
    bags, out = _split(paths, alone=shown or json or preview is not None)
    if out is not None:
        for bag in bags:
            refuse_inside(bag, out)
    if preview is not None:
        check_preview(preview, bags, out)
    keep_freed_memory()
    request = PlanRequest(given, options, plan_file, preview)
    with ExitStack() as stack:
        opened = _open(bags, stack)
        if out is None:
            return print_look(request, opened, quiet=quiet, json=json)
        shown = shown and plan_file is None
        shown = shown and not is_restored(own_bags(opened, options)[0], options)
        return _convert(request, opened, out, shown=shown, quiet=quiet, json=json)


def _run_whole(
    paths: Sequence[Path],
    given: Mapping[str, object],
    options: ImportOptions,
    plan_file: Path | None,
    batch: BatchOptions,
    *,
    quiet: bool,
    json: bool,
) -> int:
    """Convert a collection of bags, each to a folder of its own."""
    from ..bags.search import is_bag_name
    from ..batch.collection import Collection
    from ..batch.folders import find_all_roots
    from ..batch.kitti_unit import PLAN_FILE, run_kitti_unit
    from ..batch.source_units import find_bag_units
    from .collection import run_collection

    *sources, out = paths
    if not sources:
        raise UsageError(f'{_NO_OUT}; usage: kitti-ros2 to-kitti BAG... OUT --all')
    if options.append:
        raise UsageError('--append continues one data set, and --all writes one for each bag')
    plan = {} if plan_file is None else {PLAN_FILE: plan_file}
    roots = find_all_roots(sources, is_bag_name)
    collection = Collection('to-kitti', out, '', {**given, **plan}, batch, run_kitti_unit)
    return run_collection(
        collection, lambda search: find_bag_units(roots, search), quiet=quiet, json=json
    )


def _split(paths: Sequence[Path], *, alone: bool) -> tuple[Sequence[Path], Path | None]:
    """Return the bags, and the output; None without one, if bags may be alone.

    An existing bag is never an output.

    Raises:
        UsageError: The output is missing.
    """
    from ..bags.locate import is_bag

    *bags, last = paths
    if alone and (not bags or (last.exists() and is_bag(last))):
        return paths, None
    if not bags:
        raise UsageError(f'{_NO_OUT}; usage: kitti-ros2 to-kitti BAG... OUT')
    return bags, last


def _convert(
    request: PlanRequest,
    bags: Sequence[OpenBag],
    out: Path,
    *,
    shown: bool,
    quiet: bool,
    json: bool,
) -> int:
    """Convert, after a look at the plan where one is wanted, and print a summary."""
    from ..own_bags.to_kitti import Conversion

    seen = None
    if shown or request.preview is not None:
        seen = see(request, bags)
        if shown:
            print_table(bags, seen.outlook)
        if not (quiet or json):
            say_drawn(request, seen)
    started = time.monotonic()
    notes: list[str] = []
    tell = _note if not (quiet or json) else notes.append
    progress = partial(conversion_progress, show=not (quiet or json))
    survey = None if seen is None else seen.outlook.survey
    conversion = Conversion(bags, out, request.options, request.plan_file, tell, progress, survey)
    reports = conversion.run()
    elapsed = time.monotonic() - started
    losses = tuple(loss for report in reports for loss in report.losses)
    if json:
        values = [{**asdict(each), 'losses': losses_json(each.losses)} for each in reports]
        result = {'path': out, 'recordings': values, 'notes': notes, 'seconds': elapsed}
        print_json(result | drawn_values(request, None if seen is None else seen.drawn))
    elif not quiet:
        for report in reports:
            _summarize(report, out, elapsed)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _note(text: str) -> None:
    say(f'note: {text}')


def _open(paths: Sequence[Path], stack: ExitStack) -> list[OpenBag]:
    """Open bags until the end of a stack."""
    from ..bags.open_source import open_bag_source

    return [stack.enter_context(open_bag_source(path)) for path in paths]


def _check_plan_only(paths: Sequence[Path], plan_file: Path | None) -> None:
    """Check that --plan has bags only.

    Raises:
        UsageError: It was given a plan, or an output.
    """
    from ..bags.locate import METADATA, is_bag

    texts = (path for path in paths if path.suffix in _YAML and path.name != METADATA)
    given = next(texts, plan_file)
    if given is not None:
        raise UsageError(f'--plan prints a plan; to convert by yours, give --plan-file {given}')
    last = paths[-1]
    if len(paths) > 1 and not is_bag(last):
        raise UsageError(f'--plan prints a plan and writes no {last}; leave it out')


def _print_plan(paths: Sequence[Path], options: ImportOptions) -> int:
    """Print the plan as YAML, with missing data as comments."""
    from ..importer.plan_text import format_plan
    from ..own_bags.outlook import make_outlook

    with ExitStack() as stack:
        outlook = make_outlook(_open(paths, stack), options)
        sys.stdout.write(format_plan(outlook.plan, outlook.notes))
    return EXIT_OK


def _summarize(report: ImportReport, out: Path, elapsed: float) -> None:
    for note in report.notes:
        say(f'note: {note}')
    files = ', '.join(f'{name} {count}' for name, count in sorted(report.counts.items()))
    rate = f'{report.frames / elapsed:.0f} frames/s, {report.size_bytes / elapsed / 1e6:.0f} MB/s'
    say(
        f'{format_path(out)}: layout {report.layout.value}, {report.name},'
        f' {format_count(report.frames, "frame")}, {format_bytes(report.size_bytes)} ({files});'
        f' took {elapsed:.1f} s ({rate})'
    )
