# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-kitti, and its plan, shown before anything is written."""

from __future__ import annotations

import shlex
import sys
import time
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Optional

import typer

from ..files.output_rules import losses_json, refusal_of
from ..files.processes import freeze_imports
from ..model.errors import UsageError, format_bytes, format_count, one_line
from ..model.streams import Stream
from ..options.table import make_import_options, split_batch_options
from .command import JsonOption, QuietOption, takes
from .exits import EXIT_LOSSES, EXIT_OK
from .output import (
    cell,
    console,
    conversion_progress,
    format_path,
    plain_table,
    print_json,
    print_result,
    report_values,
    say,
    show_losses,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from rich.console import Console
    from rich.table import Table

    from ..bags.bag_files import OpenBag
    from ..importer.apply_plan import PlannedTopic, PlanOverview
    from ..importer.kitti_frames import ImportReport
    from ..options.outputs import ImportOptions
    from ..options.table import BatchOptions
    from ..own_bags.to_kitti import PlanProposal
    from ..pictures.preview import Preview


# The plan of a conversion as a table for a terminal, and as values for JSON.

_MOST_UNUSED = 12
_COLUMNS = ('topic', 'type', 'count', 'Hz', 'frame')
_NUMBERS = ('count', 'Hz')
_SPARE = ('frame', 'Hz', 'type')
"""Columns that a narrow terminal leaves out, in this order, before a name is broken."""
_WIDEST = 10_000
_UNUSED = '-'
_UNUSED_NOTE = 'passed over: '
_SHORT = {Stream.CALIBRATION.value: 'calib'}
"""Short names of streams for the table."""


def print_plan(names: str, proposal: PlanProposal, overview: PlanOverview) -> None:
    """Print which topic becomes which stream, and the unused topics.

    Args:
        names: Names of the bags.
        proposal: The plan and how it was made.
        overview: Streams, topics and faults by the plan.
    """
    screen = console(soft_wrap=True)
    screen.print(one_line(f'{names}: {_head(proposal, overview)}'), style='bold', markup=False)
    table, left_out = _topic_table(overview, screen)
    screen.print(table, soft_wrap=False)
    if overview.unused:
        say(f'{_UNUSED}: passed over in this layout')
    if left_out:
        say(f'not shown at this width: {", ".join(left_out)}; all with --json')


def _head(proposal: PlanProposal, overview: PlanOverview) -> str:
    plan = overview.plan
    because = f' ({proposal.reason})' if proposal.reason else ''
    head = f'layout {plan.layout.value}{because}, {plan.name}'
    if overview.frames is None:
        return head
    return f'{head}, {format_count(overview.frames, "frame")}, one for each {plan.reference}'


def _topic_table(overview: PlanOverview, screen: Console) -> tuple[Table, Sequence[str]]:
    """Return the table, without the columns that would break names, and the names of these."""
    wide = screen.options.update(max_width=_WIDEST)
    for count in range(len(_SPARE) + 1):
        table = _make_table(overview, _SPARE[:count])
        if screen.measure(table, options=wide).maximum <= screen.width:
            break
    return table, _SPARE[:count]


def _make_table(overview: PlanOverview, left_out: Collection[str]) -> Table:
    table = plain_table('stream', ())
    names = [name for name in _COLUMNS if name not in left_out]
    for name in names:
        is_number = name in _NUMBERS
        table.add_column(
            name, overflow='fold', justify='right' if is_number else 'left', no_wrap=is_number
        )
    shown = overview.unused[:_MOST_UNUSED]
    for topic in (*overview.used, *shown):
        stream = ' '.join(_SHORT.get(name, name) for name in topic.streams)
        cells = _cells(topic)
        table.add_row(_UNUSED if topic in shown else stream, *(cells[name] for name in names))
    rest = len(overview.unused) - len(shown)
    if rest > 0:
        table.add_row(_UNUSED, f'{rest} more; all with --json')
    return table


def _cells(topic: PlannedTopic) -> dict[str, str]:
    """Return the cells of a topic by column."""
    rate = '' if topic.rate_hz is None else f'{topic.rate_hz:.1f}'
    kind = topic.msgtype.rsplit('/', 1)[-1]
    values = cell(topic.topic), cell(kind), f'{topic.count}', rate, cell(topic.frame)
    return dict(zip(_COLUMNS, values, strict=True))


def print_notes(proposal: PlanProposal, overview: PlanOverview) -> None:
    """Print why a conversion would fail, the notes, and the layouts to choose from."""
    for fault in overview.faults:
        say(f'cannot be converted: {fault}')
    for note in _joined(dict.fromkeys((*proposal.notes, *overview.notes))):
        say(f'note: {note}')
    if proposal.layouts:
        table = plain_table('layout')
        table.add_column('streams', overflow='fold')
        for layout, streams in proposal.layouts.items():
            shown = ' (shown)' if layout is proposal.plan.layout else ''
            table.add_row(layout.value + shown, ' '.join(streams))
        console().print(table)


def _joined(notes: Iterable[str]) -> Iterator[str]:
    """Yield notes; those on single unused topics are joined at the position of the first."""
    notes = list(notes)
    parts = [note.removeprefix(_UNUSED_NOTE).partition('; ') for note in notes if _is_single(note)]
    for note in notes:
        if not _is_single(note):
            yield note
        elif parts:
            yield _UNUSED_NOTE + '; '.join(f'{topic}, {reason}' for topic, _, reason in parts)
            parts = []


def _is_single(note: str) -> bool:
    return note.startswith(_UNUSED_NOTE) and '; ' in note


def print_next(commands: Iterable[tuple[str, str]]) -> None:
    """Print commands that may follow, each below its purpose."""
    say('Next:')
    for purpose, command in commands:
        sys.stdout.write(f'  # {one_line(purpose)}\n  {one_line(command)}\n')


def plan_values(
    paths: Iterable[Path], proposal: PlanProposal, overview: PlanOverview
) -> dict[str, object]:
    """Return a plan and its overview for JSON."""
    return {
        'bags': list(paths),
        'layout': overview.plan.layout.value,
        'frames': overview.frames,
        'topics': [asdict(topic) for topic in overview.used],
        'passed_over': [asdict(topic) for topic in overview.unused],
        'faults': overview.faults,
        'notes': tuple(dict.fromkeys((*proposal.notes, *overview.notes))),
        'layouts': _by_name(proposal),
        'plan': asdict(overview.plan),
    }


def _by_name(proposal: PlanProposal) -> Mapping[str, object]:
    """Return the streams of each possible layout."""
    if proposal.layouts is None:
        return {}
    return {layout.value: streams for layout, streams in proposal.layouts.items()}


# The plan before anything is written: its table, its preview.

_OF_THE_PLAN = ('layout', 'name', 'calib')
"""Options that --plan takes as well."""
_SPELLINGS = {'train_fraction': 'split'}


@dataclass(frozen=True)
class PlanRequest:
    """Request to show a plan.

    Attributes:
        given: Options by name, as the user gave them.
        options: The same, parsed.
        plan_file: A plan to use.
        preview: The picture to write, if any.
    """

    given: Mapping[str, Any]
    options: ImportOptions
    plan_file: Path | None
    preview: Path | None


class PreparedPlan(NamedTuple):
    """A plan, and its preview if one is requested."""

    proposal: PlanProposal
    drawn: Preview | None


def check_preview(preview: Path, bags: Sequence[Path], out: Path | None) -> None:
    """Raise for an invalid path of a picture before anything is read.

    Raises:
        UsageError: Its ending is unsupported, or it lies in a bag or in the output.
    """
    from ..files.staging import lies_inside, refuse_inside
    from ..pictures.series import PICTURES

    if preview.suffix.lower() not in PICTURES:
        raise UsageError(f'--preview {preview}: unsupported ending; expected {", ".join(PICTURES)}')
    for bag in bags:
        refuse_inside(bag, preview)
    if out is not None and lies_inside(preview, out):
        raise UsageError(
            f'--preview {preview}: lies inside OUT, which must be new or empty; give a path'
            f' outside of it'
        )


def prepare_plan(
    request: PlanRequest, bags: Sequence[OpenBag], *, any_layout: bool = False
) -> PreparedPlan:
    """Survey bags, make or read their plan, and write the preview if there is one.

    Args:
        request: The request.
        bags: Bags of one recording.
        any_layout: Whether a missing layout is chosen by the content of the bags.
    """
    from ..files.staging import staged_file
    from ..own_bags.to_kitti import propose_plan

    with ExitStack() as exit_stack:
        picture_path = None
        if request.preview is not None:
            from ..pictures.series import keep_all_but_pictures

            refusal = refusal_of(keep_all_but_pictures, overwrite=request.options.overwrite)
            # Entered first: an existing file is refused before bags are read.
            picture_path = exit_stack.enter_context(staged_file(request.preview, refusal))
        proposal = propose_plan(bags, request.options, request.plan_file, any_layout=any_layout)
        drawn = None
        if picture_path is not None:
            from ..pictures.series import write_picture

            drawn = _draw(request, bags, proposal)
            write_picture(picture_path, drawn.picture)
    return PreparedPlan(proposal, drawn)


def _draw(request: PlanRequest, bags: Sequence[OpenBag], proposal: PlanProposal) -> Preview:
    """Draw frames as a conversion would write them: by the plan, or the original files."""
    from ..importer.survey import survey_bags
    from ..own_bags.recording import open_own_recording
    from ..pictures.preview import draw_preview, draw_recorded
    from ..pictures.recording_frames import RecordingFrames

    if proposal.restored:
        survey = proposal.survey if len(bags) == 1 else survey_bags(bags[:1])
        recording = open_own_recording(bags[0], survey)
        if recording is not None:
            with closing(RecordingFrames(recording)) as source:
                return draw_recorded(source, request.options.selection)
    return draw_preview(bags, proposal.plan, proposal.survey, proposal.options)


def print_table(bags: Sequence[OpenBag], proposal: PlanProposal) -> PlanOverview:
    """Print which topic becomes which stream."""
    from ..bags.bag_files import path_of

    names = ', '.join(format_path(path_of(bag)) for bag in bags)
    overview = _plan_overview(bags, proposal)
    print_plan(names, proposal, overview)
    return overview


def _plan_overview(bags: Sequence[OpenBag], proposal: PlanProposal) -> PlanOverview:
    from ..importer.apply_plan import make_plan_overview

    return make_plan_overview(bags, proposal.plan, proposal.survey, proposal.options.selection)


def show_plan(request: PlanRequest, bags: Sequence[OpenBag], *, quiet: bool, json: bool) -> int:
    """Show the plan of bags without an output, or write the preview; return the exit code."""
    from ..bags.bag_files import path_of

    prepared = prepare_plan(request, bags, any_layout=True)
    losses = () if prepared.drawn is None else prepared.drawn.losses
    if json:
        overview = _plan_overview(bags, prepared.proposal)
        values = plan_values([path_of(bag) for bag in bags], prepared.proposal, overview)
        print_json(values | drawn_values(request, prepared.drawn))
    elif request.preview is None:
        overview = print_table(bags, prepared.proposal)
        print_notes(prepared.proposal, overview)
        print_next(_commands(request, bags, prepared.proposal, overview))
    elif not quiet:
        say_drawn(request, prepared)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def say_drawn(request: PlanRequest, prepared: PreparedPlan) -> None:
    """Print the frames and the size of the preview, if there is one, and missing data."""
    drawn = prepared.drawn
    if request.preview is None or drawn is None:
        return
    for reason in drawn.missing:
        say(f'note: {reason}')
    numbers = ', '.join(map(str, drawn.numbers))
    height, width = drawn.picture.shape[:2]
    size = format_bytes(request.preview.stat().st_size)
    layout = prepared.proposal.plan.layout.value
    summary = f'layout {layout}, frames {numbers}, {width}x{height}, {size}'
    say(f'{format_path(request.preview)}: preview, {summary}')


def drawn_values(request: PlanRequest, drawn: Preview | None) -> dict[str, object]:
    """Return the preview for JSON; nothing without one."""
    if drawn is None:
        return {}
    shown = {'path': request.preview, 'frames': drawn.numbers, 'missing': drawn.missing}
    return {'preview': shown | {'losses': losses_json(drawn.losses)}}


def _commands(
    request: PlanRequest, bags: Sequence[OpenBag], proposal: PlanProposal, overview: PlanOverview
) -> Iterator[tuple[str, str]]:
    """Yield the purpose and the words of commands that may follow."""
    from ..bags.bag_files import path_of

    given = dict(request.given)
    plan_file = [] if request.plan_file is None else ['--plan-file', str(request.plan_file)]
    if not plan_file and not proposal.restored:
        given['layout'] = proposal.plan.layout.value
    start = ['kitti-ros2', 'to-kitti', *(str(path_of(bag)) for bag in bags)]
    of_the_plan = _words({name: given[name] for name in _OF_THE_PLAN if name in given})
    if not overview.faults and (proposal.plan.scan or proposal.plan.cameras):
        preview = [*start, *plan_file, *_words(given), '--preview', 'preview.png']
        yield 'see points and boxes of three frames on the images', shlex.join(preview)
    if not plan_file:
        plan = shlex.join([*start, *of_the_plan, '--plan'])
        yield 'edit the plan, then pass it with --plan-file plan.yaml', f'{plan} > plan.yaml'
    if not overview.faults:
        yield 'convert', shlex.join([*start, 'OUT', *plan_file, *_words(given)])


def _words(given: Mapping[str, Any]) -> Iterator[str]:
    """Yield options as words of a command line."""
    for name, value in given.items():
        spelling = _SPELLINGS.get(name, name).replace('_', '-')
        if isinstance(value, bool):
            yield f'--{spelling}' if value else f'--no-{spelling}'
        else:
            yield from (f'--{spelling}', str(value))


# kitti-ros2 to-kitti.

_NO_OUT = 'OUT is missing (the folder to create)'
_YAML = {'.yaml', '.yml'}


def _run_all(
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
    from ..batch.collection import Collection
    from ..batch.job_functions import PLAN_FILE, run_kitti_job
    from ..batch.jobs import find_all_roots, find_bag_jobs
    from .run_all import run_collection

    *sources, out = paths
    if not sources:
        raise UsageError(f'{_NO_OUT}; usage: kitti-ros2 to-kitti BAG... OUT --all')
    if options.append:
        raise UsageError('--append continues one data set, and --all writes one for each bag')
    plan = {} if plan_file is None else {PLAN_FILE: plan_file}
    roots = find_all_roots(sources)
    collection = Collection('to-kitti', out, '', {**given, **plan}, batch, run_kitti_job)
    return run_collection(
        collection, lambda search: find_bag_jobs(roots, search), quiet=quiet, json=json
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
    """Convert, after showing the plan if requested, and print a summary."""
    from ..own_bags.to_kitti import Conversion

    prepared = None
    if shown or request.preview is not None:
        prepared = prepare_plan(request, bags)
        if shown:
            print_table(bags, prepared.proposal)
        if not (quiet or json):
            say_drawn(request, prepared)
    started = time.monotonic()
    notes: list[str] = []
    note = _note if not (quiet or json) else notes.append
    progress = partial(conversion_progress, show=not (quiet or json))
    survey = None if prepared is None else prepared.proposal.survey
    conversion = Conversion(bags, out, request.options, request.plan_file, note, progress, survey)
    reports = conversion.run()
    elapsed = time.monotonic() - started
    losses = tuple(loss for report in reports for loss in report.losses)

    def values() -> dict[str, object]:
        recordings = [*map(report_values, reports)]
        result = {'path': out, 'recordings': recordings, 'notes': notes, 'seconds': elapsed}
        return result | drawn_values(request, None if prepared is None else prepared.drawn)

    def show() -> None:
        for report in reports:
            _summarize(report, out, elapsed)

    return print_result(values, show, losses, json=json, quiet=quiet)


def _note(text: str) -> None:
    say(f'note: {text}')


def _open(
    paths: Sequence[Path], exit_stack: ExitStack, *, whole_chunks: bool = False
) -> list[OpenBag]:
    """Open bags, as OpenBag does; the exit stack closes them."""
    from ..bags.open_source import open_bag_source

    return [
        exit_stack.enter_context(open_bag_source(path, whole_chunks=whole_chunks)) for path in paths
    ]


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
    from ..importer.plan import format_plan
    from ..own_bags.to_kitti import propose_plan

    with ExitStack() as exit_stack:
        proposal = propose_plan(_open(paths, exit_stack), options)
        sys.stdout.write(format_plan(proposal.plan, proposal.notes))
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


@takes('TO_KITTI_ALL')
def to_kitti(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='BAG... OUT',
            help='Bags of one recording, then the folder to create; a terminal shows the plan'
            ' where OUT is left out',
        ),
    ],
    plan: Annotated[
        bool, typer.Option('--plan', help='Print which topic is which stream, and stop; no OUT')
    ] = False,
    plan_file: Annotated[
        Optional[Path],
        typer.Option(metavar='PATH', help='Use this plan, in the format that --plan prints'),
    ] = None,
    preview: Annotated[
        Optional[Path],
        typer.Option(
            metavar='PATH',
            help='First draw points and boxes of three frames on the images (.png, .jpg, .webp);'
            ' without OUT only that',
        ),
    ] = None,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.

    A bag written by to-bag becomes the original recording; others, and with another --layout also
    such a bag (of KITTI-360), are converted by a plan. In a terminal, a bag without OUT shows the
    plan: which topic becomes what. With --all: every bag below BAG, to OUT/NAME.

    Examples:
      kitti-ros2 to-kitti drive_0005.mcap raw_data
      kitti-ros2 to-kitti drive.bag my_set --layout object --start 10s --end 20s
    """
    from ..files.processes import keep_freed_memory
    from ..files.staging import refuse_inside
    from ..own_bags.to_kitti import is_restored, own_bags

    freeze_imports()
    batch, given = split_batch_options(given)
    options = make_import_options(given)
    if batch.whole:
        if plan or preview is not None:
            raise UsageError(
                '--plan and --preview look at the bags of one recording; leave out --all'
            )
        return _run_all(paths, given, options, plan_file, batch, quiet=quiet, json=json)
    if plan:
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
    with ExitStack() as exit_stack:
        opened = _open(bags, exit_stack, whole_chunks=out is not None)
        if out is None:
            return show_plan(request, opened, quiet=quiet, json=json)
        shown = shown and plan_file is None
        shown = shown and not is_restored(own_bags(opened, options)[0], options)
        return _convert(request, opened, out, shown=shown, quiet=quiet, json=json)
