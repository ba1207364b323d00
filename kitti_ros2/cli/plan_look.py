# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A look at the plan of a conversion before anything is written: its table, its preview."""

from __future__ import annotations

import shlex
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from ..files.replacing import keep_all
from ..model.errors import UsageError
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .json_text import losses_json, print_json
from .text import format_bytes, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.reader import OpenBag
    from ..importer.plan_overview import PlanOverview
    from ..options.importing import ImportOptions
    from ..own_bags.outlook import Outlook
    from ..pictures.preview import Preview

_OF_THE_PLAN = ('layout', 'name', 'calib')
"""Options that --plan takes as well."""
_SPELLINGS = {'train_fraction': 'split'}


@dataclass(frozen=True)
class PlanRequest:
    """What a user wants to see of a plan.

    Attributes:
        given: Options by name, as the user gave them.
        options: The same.
        plan_file: A plan to use.
        preview: The picture to write, if any.
    """

    given: Mapping[str, Any]
    options: ImportOptions
    plan_file: Path | None
    preview: Path | None


class Seen(NamedTuple):
    """The result of a look: the plan, and the preview if one is requested."""

    outlook: Outlook
    drawn: Preview | None


def check_preview(preview: Path, bags: Sequence[Path], out: Path | None) -> None:
    """Raise for an invalid path of a picture before anything is read.

    Raises:
        UsageError: Its ending is unsupported, or it lies in a bag or in the output.
    """
    from ..files.staging import lies_inside, refuse_inside
    from ..pictures.output import PICTURES

    if preview.suffix.lower() not in PICTURES:
        raise UsageError(f'--preview {preview}: unsupported ending; expected {", ".join(PICTURES)}')
    for bag in bags:
        refuse_inside(bag, preview)
    if out is not None and lies_inside(preview, out):
        raise UsageError(
            f'--preview {preview}: lies inside OUT, which must be new or empty; give a path'
            f' outside of it'
        )


def see(request: PlanRequest, bags: Sequence[OpenBag], *, any_layout: bool = False) -> Seen:
    """Survey bags, make or read their plan, and write the preview if there is one.

    Args:
        request: What is wanted.
        bags: Those of one recording.
        any_layout: Whether a missing layout is chosen by the content of the bags.
    """
    from ..files.staging import staged_file
    from ..own_bags.outlook import make_outlook

    with ExitStack() as stack:
        place = None
        if request.preview is not None:
            from ..pictures.output import keep_all_but_pictures

            refusal = keep_all_but_pictures if request.options.overwrite else keep_all
            # Entered first: an existing file is refused before bags are read.
            place = stack.enter_context(staged_file(request.preview, refusal))
        outlook = make_outlook(bags, request.options, request.plan_file, any_layout=any_layout)
        drawn = None
        if place is not None:
            from ..pictures.output import write_picture

            drawn = _draw(request, bags, outlook)
            write_picture(place, drawn.picture)
    return Seen(outlook, drawn)


def _draw(request: PlanRequest, bags: Sequence[OpenBag], outlook: Outlook) -> Preview:
    """Draw what a conversion would write: by the plan, or the original files."""
    from ..bags.reader import path_of
    from ..importer.survey import look
    from ..pictures.preview import draw_preview, draw_recorded
    from ..pictures.recording_frames import RecordingFrames
    from ..pictures.sources import open_own_recording

    if outlook.restored:
        survey = outlook.survey if len(bags) == 1 else look(bags[:1])
        recording = open_own_recording(bags[0], survey)
        if recording is not None:
            with closing(RecordingFrames(recording, path_of(bags[0]).name)) as source:
                return draw_recorded(source, request.options.selection)
    return draw_preview(bags, outlook.plan, outlook.survey, outlook.options)


def print_table(bags: Sequence[OpenBag], outlook: Outlook) -> PlanOverview:
    """Print which topic becomes which stream."""
    from ..bags.reader import path_of
    from .plan_table import print_plan

    names = ', '.join(format_path(path_of(bag)) for bag in bags)
    overview = _overlook(bags, outlook)
    print_plan(names, outlook, overview)
    return overview


def _overlook(bags: Sequence[OpenBag], outlook: Outlook) -> PlanOverview:
    from ..importer.plan_overview import overlook_plan

    return overlook_plan(bags, outlook.plan, outlook.survey, outlook.options.selection)


def print_look(request: PlanRequest, bags: Sequence[OpenBag], *, quiet: bool, json: bool) -> int:
    """Show the plan of bags without an output, or write the preview; return the exit code."""
    from ..bags.reader import path_of

    seen = see(request, bags, any_layout=True)
    losses = () if seen.drawn is None else seen.drawn.losses
    if json:
        from .plan_table import plan_values

        overview = _overlook(bags, seen.outlook)
        values = plan_values([path_of(bag) for bag in bags], seen.outlook, overview)
        print_json(values | drawn_values(request, seen.drawn))
    elif request.preview is None:
        from .plan_table import print_next, print_remarks

        overview = print_table(bags, seen.outlook)
        print_remarks(seen.outlook, overview)
        print_next(_commands(request, bags, seen.outlook, overview))
    elif not quiet:
        say_drawn(request, seen)
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def say_drawn(request: PlanRequest, seen: Seen) -> None:
    """Print what the preview shows, if there is one, and what could not be drawn."""
    drawn = seen.drawn
    if request.preview is None or drawn is None:
        return
    for reason in drawn.missing:
        say(f'note: {reason}')
    numbers = ', '.join(map(str, drawn.numbers))
    height, width = drawn.picture.shape[:2]
    size = format_bytes(request.preview.stat().st_size)
    layout = seen.outlook.plan.layout.value
    what = f'layout {layout}, frames {numbers}, {width}x{height}, {size}'
    say(f'{format_path(request.preview)}: preview, {what}')


def drawn_values(request: PlanRequest, drawn: Preview | None) -> dict[str, object]:
    """Return what the preview shows, for JSON; nothing without one."""
    if drawn is None:
        return {}
    shown = {'path': request.preview, 'frames': drawn.numbers, 'missing': drawn.missing}
    return {'preview': shown | {'losses': losses_json(drawn.losses)}}


def _commands(
    request: PlanRequest, bags: Sequence[OpenBag], outlook: Outlook, overview: PlanOverview
) -> Iterator[tuple[str, str]]:
    """Yield the purpose and the words of commands that may follow."""
    from ..bags.reader import path_of

    given = dict(request.given)
    plan_file = [] if request.plan_file is None else ['--plan-file', str(request.plan_file)]
    if not plan_file and not outlook.restored:
        given['layout'] = outlook.plan.layout.value
    start = ['kitti-ros2', 'to-kitti', *(str(path_of(bag)) for bag in bags)]
    of_the_plan = _words({name: given[name] for name in _OF_THE_PLAN if name in given})
    if not overview.faults and (outlook.plan.scan or outlook.plan.cameras):
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
