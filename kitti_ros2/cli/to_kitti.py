# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..bags.open_source import open_bag_source
from ..files.staging import refuse_inside
from ..model.errors import UsageError
from ..options.table import make_import_options
from ..own_bags.to_kitti import Conversion, own_bags
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .memory import keep_freed_memory, keep_imports
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..importer.report import ImportReport
    from ..options.importing import ImportOptions


def run_to_kitti(
    paths: Sequence[Path],
    given: Mapping[str, Any],
    plan_file: Path | None,
    *,
    plan_only: bool,
    quiet: bool,
    json: bool = False,
) -> int:
    """Convert and print a summary; or print the plan.

    Args:
        paths: Bags, and the output last unless plan_only.
        given: Options by name.
        plan_file: A plan to use.
        plan_only: Whether to print the plan and stop.
        quiet: Print only losses.
        json: Whether to print the summary as JSON.

    Returns:
        The exit code.

    Raises:
        UsageError: The arguments are invalid.
    """
    keep_imports()
    options = make_import_options(given)
    if plan_only:
        if options.overwrite or not options.selection.is_whole or json:
            raise UsageError(
                '--plan prints the plan of all frames, as YAML; give --start, --end, --overwrite'
                ' and --json with the conversion'
            )
        return _print_plan(paths, options)
    if len(paths) < 2:
        raise UsageError(
            'OUT is missing (the folder to create); usage: kitti-ros2 to-kitti BAG... OUT'
        )
    *bags, out = paths
    for bag in bags:
        refuse_inside(bag, out)
    keep_freed_memory()
    started = time.monotonic()
    notes: list[str] = []
    tell = _note if not (quiet or json) else notes.append
    with ExitStack() as stack:
        opened = _open(bags, stack)
        show = not (quiet or json)
        progress = partial(conversion_progress, show=show)
        reports = Conversion(opened, out, options, plan_file, tell, progress).run()
    elapsed = time.monotonic() - started
    losses = tuple(loss for report in reports for loss in report.losses)
    if json:
        values = [{**asdict(each), 'losses': losses_json(each.losses)} for each in reports]
        print_json({'path': out, 'recordings': values, 'notes': notes, 'seconds': elapsed})
    elif not quiet:
        for report in reports:
            _summarize(report, out, elapsed)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _note(text: str) -> None:
    say(f'note: {text}')


def _open(paths: Sequence[Path], stack: ExitStack) -> list[OpenBag]:
    """Open bags until the end of a stack."""
    return [stack.enter_context(open_bag_source(path)) for path in paths]


def _print_plan(paths: Sequence[Path], options: ImportOptions) -> int:
    """Print the plan as YAML, with missing data as comments."""
    with ExitStack() as stack:
        sys.stdout.write(_make_plan(_open(paths, stack), options))
    return EXIT_OK


def _make_plan(bags: Sequence[OpenBag], options: ImportOptions) -> str:
    from ..importer.apply_plan import guess
    from ..importer.plan import format_plan
    from ..importer.survey import look

    notes: tuple[str, ...] = ()
    own, damaged = own_bags(bags, options)
    if own:
        blueprint = own[0][1]
        if options.layout in (None, blueprint.layout):
            named = options.name or blueprint.name
            options = replace(options, layout=blueprint.layout, name=named)
        name = blueprint.name
        notes = (f'made by to-bag: without a plan every file of {name} comes back as it was',)
    survey = look(bags)
    found = guess(bags, survey, options)
    notes += (*found.notes, *(loss.text() for loss in (*damaged, *found.losses)))
    notes += (*survey.notes, *survey.losses)
    notes = tuple(dict.fromkeys(notes))
    return format_plan(found.plan, notes)


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
