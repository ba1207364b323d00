# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of the command line, and the parser of its arguments."""

import os
from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import typer

from ..model.errors import UsageError
from .commands.command import Command
from .commands.crop import crop
from .commands.declared import add_options
from .commands.demo import demo
from .commands.download import download
from .commands.eval_detection import eval_detection
from .commands.eval_live import eval_live
from .commands.eval_odometry import eval_odometry
from .commands.eval_tracking import eval_tracking
from .commands.extract import extract
from .commands.info import info
from .commands.play import play
from .commands.recover import recover
from .commands.report import report
from .commands.split import split
from .commands.stacks import stacks
from .commands.stats import stats
from .commands.status import status
from .commands.to_bag import to_bag
from .commands.to_kitti import to_kitti
from .commands.validate import validate
from .commands.view import view
from .completion import VARIABLE, answering, complete_at_first_tab, completion_words
from .exit_codes import EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE

app = typer.Typer(
    name='kitti-ros2',
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={'help_option_names': ['-h', '--help']},
)


def command_names() -> list[str]:
    """Return the names of all sub-commands; those of a group are two words."""
    return [' '.join(words) for words in _ALL]


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
    for word in requested or words[:1]:
        found = found.commands[word]
    return ' '.join(requested), found


def _requested(words: list[str]) -> tuple[str, ...]:
    return next((key for key in _ALL if (*words[: len(key)],) == key), ())


@cache
def _command_for(requested: tuple[str, ...]) -> Any:  # noqa: ANN401 - as above
    if requested:
        add_options(_ALL[requested])
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


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option('--version', callback=_version, is_eager=True, help='Print the version.')
    ] = False,
    debug: Annotated[bool, typer.Option('--debug', help='Show tracebacks.')] = False,
) -> None:
    """KITTI for ROS 2: play, draw, convert to bags and back; get, check, cut data; score results.

    Exit codes: 0 success, 1 some data was skipped (it is listed), 2 invalid usage or unreadable
    input.
    """


_COMMANDS: dict[str, Callable[..., int]] = {
    'info': info,
    'play': play,
    'view': view,
    'report': report,
    'to-bag': to_bag,
    'to-kitti': to_kitti,
    'status': status,
    'recover': recover,
    'download': download,
    'extract': extract,
    'validate': validate,
    'stats': stats,
    'crop': crop,
    'split': split,
    'stacks': stacks,
    'demo': demo,
}
_EVAL: dict[str, Callable[..., int]] = {
    'detection': eval_detection,
    'odometry': eval_odometry,
    'tracking': eval_tracking,
    'live': eval_live,
}
_ALL: dict[tuple[str, ...], Callable[..., int]] = {
    **{(name,): command for name, command in _COMMANDS.items()},
    **{('eval', name): command for name, command in _EVAL.items()},
}
for _name, _command in _COMMANDS.items():
    app.command(_name, cls=Command)(_command)

_eval_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
for _name, _command in _EVAL.items():
    _eval_app.command(_name, cls=Command)(_command)


@_eval_app.callback()
def _eval() -> None:
    """Score detections, tracks and trajectories as KITTI does."""


app.add_typer(_eval_app, name='eval')
