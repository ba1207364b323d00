# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti."""

from __future__ import annotations

import sys
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from ..bags.reader import OpenBag, bag_stamps
from ..files.staging import refuse_inside
from ..messages.source import RECORDING
from ..model.errors import UsageError
from ..model.losses import Loss
from ..options.table import make_import_options
from ..own_bags.part import select_part, select_times
from ..own_bags.recorded_layout import EarlierVersionError, UndescribedError, find_blueprint
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .memory import keep_freed_memory, keep_imports
from .progress import conversion_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

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
        raise UsageError('to-kitti needs a bag and a folder to create: kitti-ros2 to-kitti BAG OUT')
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
        reports = _Conversion(opened, out, options, plan_file, tell, show).run()
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
    return [stack.enter_context(OpenBag(path)) for path in paths]


@dataclass(frozen=True)
class _Conversion:
    """A conversion of bags to a data set.

    Attributes:
        bags: All bags of the call.
        out: The data set.
        options: Of the conversion.
        plan_file: A plan to use.
        tell: Called with the notes known before anything is written.
        show: Whether to show the progress.
    """

    bags: Sequence[OpenBag]
    out: Path
    options: ImportOptions
    plan_file: Path | None
    tell: Callable[[str], None]
    show: bool

    def run(self) -> list[ImportReport]:
        """Restore the recordings of bags written by to-bag, or convert by a plan."""
        from ..own_bags.restore import restore

        options = self.options
        own, losses = _own(self.bags, options, planned=self.plan_file is not None)
        keeps = all(options.keeps(blueprint.layout) for _, blueprint in own)
        if not own or not keeps or self.plan_file is not None:
            return [self._convert_by_plan(own, losses)]
        selected = [(bag, select_part(bag, each, options.selection)) for bag, each in own]
        files = sum(blueprint.files for _, blueprint in selected)
        frames = sum(_count_frames(*each) for each in selected)
        with conversion_progress(files, frames, show=self.show) as progress:
            return restore(selected, self.out, progress, overwrite=options.overwrite)

    def _convert_by_plan(
        self, recordings: Sequence[tuple[OpenBag, Blueprint]], losses: tuple[Loss, ...]
    ) -> ImportReport:
        """Convert by a plan.

        Args:
            recordings: The bags with their layouts, if to-bag wrote all of them.
            losses: Their damaged descriptions.
        """
        from ..importer.append import mend
        from ..importer.apply_plan import adapt, convert_by_plan, guess
        from ..importer.frames import frame_topics, topic_of
        from ..importer.plan import parse_plan
        from ..importer.survey import look
        from ..kitti.store import STORE

        survey = look(self.bags)
        counts = {topic.name: topic.count for topic in survey.topics.values()}
        for _, blueprint in recordings:
            losses += (*blueprint.losses, *blueprint.shortfall(counts))
        if self.plan_file is not None:
            plan = adapt(parse_plan(STORE.read_text(self.plan_file), self.plan_file), self.options)
        else:
            found = guess(self.bags, survey, self.options)
            plan, losses = found.plan, (*losses, *found.losses)
            for note in found.notes:
                self.tell(note)
        for note in mend(self.out) if self.options.append else ():
            self.tell(note)
        topics = frame_topics(plan)
        options = self.options
        if len(recordings) == 1:
            reference = next((t for s, t in topics.items() if s.value == plan.reference), '')
            selection = select_times(*recordings[0], reference, options.selection)
            options = replace(options, selection=selection)
        samples = sum(topic_of(survey, topic).count for topic in topics.values())
        with conversion_progress(samples, samples, show=self.show) as progress:
            report = convert_by_plan(self.bags, plan, survey, self.out, options, progress)
        reported = {loss.text() for loss in losses}
        notes = tuple(note for note in report.notes if note not in reported)
        return replace(report, losses=(*losses, *report.losses), notes=notes)


def _count_frames(bag: OpenBag, blueprint: Blueprint) -> int:
    from ..own_bags.numbering import number_bag

    if blueprint.selected is not None:
        return len(frozenset().union(*map(blueprint.requested, blueprint.folders)))
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
