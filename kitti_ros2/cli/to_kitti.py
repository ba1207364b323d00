# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..bags.reader import OpenBag
from ..files.staging import refuse_inside
from ..model.errors import UsageError
from ..options.table import make_import_options
from ..own_bags.to_kitti import convert_bags, own_bags
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_freed_memory, keep_imports
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..importer.report import ImportReport
    from ..options.importing import ImportOptions


def run_to_kitti(
    paths: Sequence[Path],
    given: Mapping[str, Any],
    plan_file: Path | None,
    *,
    plan_only: bool,
    quiet: bool,
) -> int:
    """Convert and print a summary; or print the plan.

    Args:
        paths: Bags, and the output last unless plan_only.
        given: Options by name.
        plan_file: A plan to use.
        plan_only: Whether to print the plan and stop.
        quiet: Print only losses.

    Returns:
        The exit code.

    Raises:
        UsageError: The arguments are invalid.
    """
    keep_imports()
    options = make_import_options(given)
    if plan_only:
        return _print_plan(paths, options)
    if len(paths) < 2:
        raise UsageError('to-kitti needs a bag and a folder to create: kitti-ros2 to-kitti BAG OUT')
    *bags, out = paths
    for bag in bags:
        refuse_inside(bag, out)
    keep_freed_memory()
    started = time.monotonic()
    with ExitStack() as stack:
        opened = _open(bags, stack)
        reports = convert_bags(
            opened,
            out,
            options,
            plan_file,
            partial(conversion_progress, show=not quiet),
            (lambda _: None) if quiet else (lambda note: say(f'note: {note}')),
        )
    elapsed = time.monotonic() - started
    for report in () if quiet else reports:
        _summarize(report, out, elapsed)
    losses = tuple(loss for report in reports for loss in report.losses)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _open(paths: Sequence[Path], stack: ExitStack) -> list[OpenBag]:
    """Open bags until the end of a stack."""
    return [stack.enter_context(OpenBag(path)) for path in paths]


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
