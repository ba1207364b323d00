# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of the command line, and the parser of its arguments."""

from __future__ import annotations

import os
import re
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..model.errors import UsageError
from .commands.command import Command
from .commands.declared import add_options
from .completion import VARIABLE, answering, complete_at_first_tab, completion_words
from .exit_codes import EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE

if TYPE_CHECKING:
    from collections.abc import Callable

_COMMANDS = {
    'info': ('info', 'Summarize a KITTI folder or a bag.'),
    'play': ('play', 'Play a KITTI folder or a bag live, in ROS 2 or for Foxglove.'),
    'view': ('view', 'Draw frames of a KITTI folder or a bag, or show it in Rerun.'),
    'report': ('report', 'Write an HTML report on a KITTI folder or a bag.'),
    'to-bag': ('to_bag', 'Write a KITTI recording to a bag (MCAP, sqlite3, ROS 1).'),
    'to-kitti': ('to_kitti', 'Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.'),
    'status': ('status', 'Show how much of a collection is done, failed and left.'),
    'recover': ('recover', 'Repair a truncated or damaged bag; each loss is listed.'),
    'download': ('download_extract', "Download KITTI's archives by name and extract them."),
    'extract': ('download_extract', "Extract KITTI's archives into the folders that readers expect."),
    'validate': ('validate', 'Check every file of KITTI folders and bags.'),
    'stats': ('stats', 'Count what is in data sets: objects, sensors, routes.'),
    'crop': ('crop_split', 'Cut scans by view, box, range, height, lasers or voxels.'),
    'split': ('crop_split', 'Divide a data set into lists such as train.txt, or check lists.'),
    'stacks': ('stacks', 'List the stacks that --for knows, or show and set up one of them.'),
    'demo': ('demo', 'Write a synthetic recording, convert it, and summarize it.'),
    'eval detection': ('eval', "Score detections: average precision as KITTI's object benchmark."),
    'eval odometry': ('eval', "Score a trajectory: KITTI's segment errors, APE and RPE."),
    'eval tracking': ('eval', 'Score tracks: HOTA, CLEAR-MOT and IDF1 of cars and pedestrians.'),
    'eval live': ('eval', 'Play to a running stack, score its results, measure its latency.'),
}
"""The module and the first line of the help of each command; those of a group are two words.

Only the requested command is imported.
"""


def command_names() -> list[str]:
    """Return the names of all sub-commands; those of a group are two words."""
    return [*_COMMANDS]


def get_command(words: list[str]) -> Any:  # noqa: ANN401 - a command of typer's own copy of click
    """Return the command line, with the options of the requested sub-command."""
    return _command_for(_requested(words))


def find_command(words: list[str]) -> tuple[str, Any]:
    """Return the name of the requested sub-command, and the command.

    Raises:
        KeyError: There is none of that name.
    """
    found = get_command(words)
    requested = _requested(words)
    for word in requested.split() or words[:1]:
        found = found.commands[word]
    return requested, found


def _requested(words: list[str]) -> str:
    """Return the name of the command that is first in the words, or nothing."""
    if words[:1] == ['--']:
        words = words[1:]
    return next((name for name in _COMMANDS if words[: len(name.split())] == name.split()), '')


@cache
def _command_for(requested: str) -> Any:  # noqa: ANN401 - as above
    app = typer.Typer(
        name='kitti-ros2',
        no_args_is_help=True,
        rich_markup_mode=None,
        context_settings={'help_option_names': ['-h', '--help']},
    )
    add_options(_root)
    app.callback()(_root)
    scores = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
    scores.callback()(_eval)
    for name in [requested] if requested else _COMMANDS:
        group, _, word = name.rpartition(' ')
        owner = scores if group else app
        if requested:
            owner.command(word, cls=Command)(_imported(name))
        else:
            owner.command(word, cls=Command, help=_COMMANDS[name][1])(_listed)
    app.add_typer(scores, name='eval')
    return typer.main.get_command(app)


def run(words: list[str]) -> int:
    """Run the requested command and return its exit code.

    Raises:
        UsageError: The arguments are invalid.
        KeyboardInterrupt: Ctrl-C.
    """
    if VARIABLE in os.environ:
        with answering():
            get_command(completion_words()).main(prog_name='kitti-ros2')
    if words[:1] in (['--install-completion'], ['--show-completion']):
        complete_at_first_tab()
    command = get_command(words)
    ros_args: list[str] = []
    if words[:1] == ['play']:
        from .play import complete_port, split_ros_args

        words, ros_args = split_ros_args(words)
        words = complete_port(words)
    try:
        result = command.main(
            args=words, prog_name='kitti-ros2', standalone_mode=False, obj=ros_args
        )
    except Exception as error:
        # typer bundles its own click, so its usage errors are recognized by their attributes.
        message = getattr(error, 'format_message', None)
        if message is None:
            raise
        if type(error).__name__ == 'NoArgsIsHelpError':
            typer.echo(message(), err=True)
            return EXIT_USAGE
        from .usage import describe_usage_error

        raise UsageError(describe_usage_error(error)) from error
    if result == EXIT_INTERRUPTED:
        raise KeyboardInterrupt  # typer has caught it
    return result if isinstance(result, int) else EXIT_OK


def _version(asked: bool) -> None:
    if asked:
        from .. import __version__

        typer.echo(f'kitti_ros2 {__version__}')
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option('--version', callback=_version, is_eager=True, help='Print the version.')
    ] = False,
    debug: Annotated[bool, typer.Option('--debug', help='Show tracebacks.')] = False,
) -> None:
    """KITTI for ROS 2: play, draw, convert to bags and back; get, check, cut data; score results.

    Exit codes: 0 success, 1 some data was skipped (it is listed), 2 invalid usage or unreadable
    input.
    """


def _eval() -> None:
    """Score detections, tracks and trajectories as KITTI does."""


def _listed() -> int:
    """Stand for a command that help texts and completions list, and that is not imported."""
    raise UsageError('a command is the first word; see kitti-ros2 --help')


def _imported(name: str) -> Callable[..., int]:
    """Return the function of a command, with its options."""
    module, _ = _COMMANDS[name]
    function = re.sub('[ -]', '_', name)
    command: Callable[..., int] = getattr(import_module(f'.{module}', __package__), function)
    add_options(command)
    return command
