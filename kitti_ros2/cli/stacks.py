# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 stacks."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from ..files.processes import freeze_imports
from ..model.errors import UsageError, not_one_of
from ..options.table import make_settings
from .command import JsonOption, OverwriteOption, QuietOption, takes
from .exits import EXIT_OK
from .output import cell, console, format_path, plain_table, print_json, say, say_error

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..api.setup_files import RunCommands
    from ..options.stack_catalogue import Stack


_COLUMNS = 80


def _write(
    stack: Stack,
    drive: Path,
    folder: Path,
    source: Mapping[str, object],
    *,
    overwrite: bool,
    json: bool,
    quiet: bool,
) -> None:
    from ..api.setup_files import write_setup

    settings = make_settings(source)
    setup = write_setup(stack, drive, folder, settings, source, overwrite=overwrite)
    if json:
        files = [str(path) for path in setup.files]
        print_json({'files': files, 'commands': asdict(setup.commands), 'notes': setup.notes})
        return
    if quiet:
        return
    for path in setup.files:
        say(format_path(path))
    _show_commands(setup.commands)
    for note in setup.notes:
        say_error(f'note: {note}')


def _list(*, json: bool, quiet: bool) -> None:
    from ..options.stack_catalogue import STACKS

    if json:
        print_json([_values(stack) for stack in STACKS.values()])
        return
    if quiet:
        return
    table = plain_table('stack')
    for heading in ('does', 'points', 'Imu', 'read at'):
        table.add_column(heading, no_wrap=True)
    for stack in STACKS.values():
        table.add_row(*map(cell, (stack.name, stack.what, stack.points, stack.imu, stack.version)))
    console(width=_COLUMNS).print(table)


def _show(stack: Stack) -> None:
    """Print all about a stack, wrapped at 80 columns."""
    say(f'{stack.title}: {stack.what}')
    _section('It asks for', [f'{demand.text}\n    {demand.source}' for demand in stack.demands])
    _section('--for sets', [_setting_text(*setting) for setting in stack.settings.items()])
    _section('Topics', [f'{own} -> {renamed}' for own, renamed in stack.topics.items()])
    _section('Frames', [f'{kind}: {name}' for kind, name in stack.frames.items()])
    moved = [f'{parent} -> {child} on /tf' for parent, child in stack.moving]
    _section('It publishes', [*stack.publishes, *moved])
    _section('Notes', [*stack.notes])
    _show_commands(_example(stack), stack.start)


def _example(stack: Stack) -> RunCommands:
    from ..api.setup_files import commands_of

    return commands_of(stack, 'DRIVE', {'imu_from': 'DRIVE_extract'} if stack.imu_hz else {})


def _section(heading: str, entries: list[str]) -> None:
    """Print entries below a heading; the text of one is wrapped, its further lines are kept."""
    if not entries:
        return
    sys.stdout.write(f'\n{heading}:\n')
    for entry in entries:
        text, *rest = entry.split('\n')
        wrapped = fill(
            text, _COLUMNS, initial_indent='  ', subsequent_indent='    ',
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip
        sys.stdout.write('\n'.join([wrapped, *rest]) + '\n')


def _setting_text(name: str, values: Sequence[object]) -> str:
    return f'{name}: {" or ".join(map(_word, values))}'


def _word(value: object) -> str:
    return {True: 'on', False: 'off'}[value] if isinstance(value, bool) else str(value)


def _show_commands(commands: RunCommands, start: str = '') -> None:
    lines = [
        ('record, in a terminal of its own', commands.record),
        ('start the stack', start),
        ('play' if start else 'run', commands.run),
        ('score', commands.score),
    ]
    sys.stdout.write('\n')
    for meaning, command in lines:
        if command:
            sys.stdout.write(f'# {meaning}\n{command}\n')


def _values(stack: Stack) -> dict[str, Any]:
    """Return all about a stack for JSON."""
    return {
        'name': stack.name,
        'title': stack.title,
        'what': stack.what,
        'points': stack.points,
        'imu': stack.imu,
        'version': stack.version,
        'demands': [asdict(demand) for demand in stack.demands],
        'options': {name: values[0] for name, values in stack.settings.items()},
        'topics': dict(stack.topics),
        'frames': dict(stack.frames),
        'publishes': stack.publishes,
        'moving': stack.moving,
        'notes': stack.notes,
        'commands': {**asdict(_example(stack)), 'start': stack.start},
    }


def _complete_stack(incomplete: str) -> list[str]:
    from ..options.stack_names import StackName

    return [name.value for name in StackName if name.value.startswith(incomplete)]


@takes('STACK_DRIVE')
def stacks(
    stack: Annotated[
        Optional[str],
        typer.Argument(
            metavar='STACK', help='One of the listed stacks', autocompletion=_complete_stack
        ),
    ] = None,
    drive: Annotated[
        Optional[Path],
        typer.Option('--drive', metavar='DRIVE', help='Write files to run STACK on a KITTI folder'),
    ] = None,
    out: Annotated[
        Optional[Path],
        typer.Option('--out', '-o', metavar='OUT', help='Folder of these files [default: STACK]'),
    ] = None,
    overwrite: OverwriteOption = False,
    json: JsonOption = False,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """List the stacks that --for knows, or show and set up one of them.

    With STACK: what it asks of messages, with the place in its source, the options, topics and
    frames that --for sets, and the commands to record, run and score it.

    With --drive: its parameter file with the extrinsics of the drive, and a launch file that
    starts it and plays the drive.

    Examples:
      kitti-ros2 stacks kiss-icp
      kitti-ros2 stacks dlio --drive 2011_09_26/2011_09_26_drive_0005_sync -o run
    """
    from ..options.stack_catalogue import STACKS

    freeze_imports()
    if drive is None and (out is not None or overwrite or given):
        raise UsageError('--out, --overwrite and the options of a source go with --drive DRIVE')
    if stack is None:
        if drive is not None:
            raise UsageError('--drive needs a STACK: kitti-ros2 stacks STACK --drive DRIVE')
        _list(json=json, quiet=quiet)
        return EXIT_OK
    if stack not in STACKS:
        raise not_one_of('STACK', stack, [*STACKS])
    chosen = STACKS[stack]
    if drive is not None:
        folder = out or Path(stack)
        _write(chosen, drive, folder, given, overwrite=overwrite, json=json, quiet=quiet)
    elif json:
        print_json(_values(chosen))
    elif not quiet:
        _show(chosen)
    return EXIT_OK
