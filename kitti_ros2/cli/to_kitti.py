# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..bags.open_source import open_bag_source
from ..bags.reader import bag_stamps
from ..files.staging import refuse_inside
from ..messages.source import RECORDING
from ..model.errors import UsageError
from ..model.losses import Loss
from ..options.table import make_import_options
from ..own_bags.recorded_layout import EarlierVersionError, UndescribedError, find_blueprint
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_freed_memory, keep_imports
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..importer.report import ImportReport
    from ..options.importing import ImportOptions
    from ..own_bags.recorded_layout import Blueprint


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
        raise UsageError(
            'OUT is missing (the folder to create); usage: kitti-ros2 to-kitti BAG... OUT'
        )
    *bags, out = paths
    for bag in bags:
        refuse_inside(bag, out)
    keep_freed_memory()
    started = time.monotonic()
    with ExitStack() as stack:
        opened = _open(bags, stack)
        reports = _convert(opened, out, options, plan_file, quiet=quiet)
    elapsed = time.monotonic() - started
    for report in () if quiet else reports:
        _summarize(report, out, elapsed)
    losses = tuple(loss for report in reports for loss in report.losses)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _open(paths: Sequence[Path], stack: ExitStack) -> list[OpenBag]:
    """Open bags until the end of a stack."""
    return [stack.enter_context(open_bag_source(path)) for path in paths]


def _convert(
    bags: Sequence[OpenBag],
    out: Path,
    options: ImportOptions,
    plan_file: Path | None,
    *,
    quiet: bool,
) -> list[ImportReport]:
    from ..own_bags.restore import restore

    recordings, losses = _own(bags, options, planned=plan_file is not None)
    keeps = all(options.keeps(blueprint.layout) for _, blueprint in recordings)
    if recordings and keeps and plan_file is None:
        files = sum(blueprint.files for _, blueprint in recordings)
        frames = sum(_count_frames(*each) for each in recordings)
        with conversion_progress(files, frames, show=not quiet) as progress:
            return restore(recordings, out, progress)
    from ..importer.append import mend
    from ..importer.apply_plan import adapt, convert_by_plan, guess
    from ..importer.frames import frame_topics, topic_of
    from ..importer.plan import parse_plan
    from ..importer.survey import look
    from ..kitti.store import STORE

    survey = look(bags)
    counts = {topic.name: topic.count for topic in survey.topics.values()}
    for _, blueprint in recordings:
        losses += (*blueprint.losses, *blueprint.shortfall(counts))
    if plan_file is not None:
        plan = adapt(parse_plan(STORE.read_text(plan_file), plan_file), options)
    else:
        found = guess(bags, survey, options)
        plan, losses = found.plan, (*losses, *found.losses)
        if not quiet:
            for note in found.notes:
                say(f'note: {note}')
    for note in mend(out) if options.append else ():
        if not quiet:
            say(f'note: {note}')
    samples = sum(topic_of(survey, topic).count for topic in frame_topics(plan).values())
    with conversion_progress(samples, samples, show=not quiet) as progress:
        report = convert_by_plan(bags, plan, survey, out, options, progress)
    reported = {loss.text() for loss in losses}
    notes = tuple(note for note in report.notes if note not in reported)
    return [replace(report, losses=(*losses, *report.losses), notes=notes)]


def _count_frames(bag: OpenBag, blueprint: Blueprint) -> int:
    from ..own_bags.numbering import number_bag

    numbered = number_bag(bag, bag_stamps(bag), blueprint=blueprint, by_header=False)
    return 0 if numbered is None else len(numbered.frames)


def _own(
    bags: Sequence[OpenBag], options: ImportOptions, *, planned: bool = False
) -> tuple[list[tuple[OpenBag, Blueprint]], tuple[Loss, ...]]:
    """Return bags written by to-bag with their original layouts, and damaged descriptions.

    Args:
        bags: All bags of the call.
        options: With a layout, a bag may be converted by a plan instead.
        planned: Whether a plan is given.

    Returns:
        No bags unless every one was written by to-bag; and the damaged descriptions.

    Raises:
        BadBagError: One is not a bag.
        UndescribedError: A description is unusable, and there is no plan.
    """
    found, losses = [], []
    for bag in bags:
        try:
            blueprint = find_blueprint(bag)
        except UndescribedError as error:
            if options.layout is None and not planned:
                raise
            if not isinstance(error, EarlierVersionError):
                losses.append(Loss(RECORDING, 1, str(error)))
            continue
        if blueprint is not None:
            found.append((bag, blueprint))
    return found if len(found) == len(bags) else [], tuple(losses)


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
    own, damaged = _own(bags, options)
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
