# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Sub-commands of the command line, the parser of arguments, and its errors."""

from __future__ import annotations

import os
import re
import shlex
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..files.remote import as_path
from ..model.bag_formats import CONTAINERS
from ..model.errors import UsageError, close_names, did_you_mean, either
from .command import Command, add_options
from .completion import VARIABLE, complete_at_first_tab, completion_timeout, completion_words
from .exits import EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE
from .given_words import OUT_FLAGS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..model.errors import Remedy


# Sub-commands of the command line, and the parser of its arguments.

_COMMANDS = {
    'info': ('info', 'Summarize a KITTI folder or a bag.'),
    'play': ('play', 'Play a KITTI folder or a bag live, in ROS 2 or for Foxglove.'),
    'view': ('view', 'Draw frames of a KITTI folder or a bag, or show it in Rerun.'),
    'report': ('report', 'Write an HTML report on a KITTI folder or a bag.'),
    'to-bag': ('to_bag', 'Write a KITTI recording or a bag to a bag (MCAP, sqlite3, ROS 1).'),
    'to-kitti': ('to_kitti', 'Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.'),
    'status': ('status', 'Show how much of a collection is done, failed and left.'),
    'recover': ('recover', 'Repair a truncated or damaged bag; each loss is listed.'),
    'download': ('download_extract', "Download KITTI's archives by name and extract them."),
    'extract': (
        'download_extract',
        "Extract KITTI's archives into the folders that readers expect.",
    ),
    'validate': ('validate', 'Check every file of KITTI folders and bags.'),
    'stats': ('stats', 'Count what is in data sets: objects, sensors, routes.'),
    'crop': ('crop_split', 'Cut scans by view, box, range, height, lasers or voxels.'),
    'split': ('crop_split', 'Divide a data set into lists such as train.txt, or check lists.'),
    'stacks': ('stacks', 'List the stacks that --for knows, or show and set up one of them.'),
    'demo': ('demo', 'Write a synthetic recording, convert it, and draw a frame.'),
    'eval detection': ('eval', "Score detections: average precision as KITTI's object benchmark."),
    'eval odometry': ('eval', "Score a trajectory: KITTI's segment errors, APE and RPE."),
    'eval tracking': ('eval', 'Score tracks: HOTA, CLEAR-MOT and IDF1 of cars and pedestrians.'),
    'eval live': ('eval', 'Play to a running stack, score its results, measure its latency.'),
}
"""Module and first line of help by command; names of a group have two words.

Only the requested command is imported.
"""


def command_names() -> list[str]:
    """Return the names of all sub-commands; those of a group have two words."""
    return [*_COMMANDS]


def get_command(words: list[str]) -> Any:  # noqa: ANN401 - a command of typer's own copy of click
    """Return the command line, with the options of the requested sub-command."""
    return _command_for(_requested(words))


def find_command(words: list[str]) -> tuple[str, Any]:
    """Return the name of the requested sub-command, and the command.

    Raises:
        KeyError: There is none of that name.
    """
    command = get_command(words)
    requested = _requested(words)
    for word in requested.split() or words[:1]:
        command = command.commands[word]
    return requested, command


def _requested(words: list[str]) -> str:
    """Return the command that the words begin with; empty if there is none."""
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
            owner.command(word, cls=Command)(_import_command(name))
        else:
            owner.command(word, cls=Command, help=_COMMANDS[name][1])(_placeholder)
    app.add_typer(scores, name='eval')
    return typer.main.get_command(app)


def run(words: list[str]) -> int:
    """Run the requested command and return its exit code.

    Raises:
        UsageError: The arguments are invalid.
        KeyboardInterrupt: Ctrl-C.
    """
    if VARIABLE in os.environ:
        with completion_timeout():
            get_command(completion_words()).main(prog_name='kitti-ros2')
    if words[:1] in (['--install-completion'], ['--show-completion']):
        complete_at_first_tab()
    if words[:1] == ['help']:
        words = [*words[1:], '--help']
    command = get_command(words)
    ros_args: list[str] = []
    if words[:1] == ['play']:
        from .play import complete_port, split_ros_args

        words, ros_args = split_ros_args(words)
        words = complete_port(words)
    try:
        code = command.main(args=words, prog_name='kitti-ros2', standalone_mode=False, obj=ros_args)
    except Exception as error:
        # typer bundles its own click, so its usage errors are recognized by their attributes.
        message = getattr(error, 'format_message', None)
        if message is None:
            raise
        if type(error).__name__ == 'NoArgsIsHelpError':
            typer.echo(message(), err=True)
            return EXIT_USAGE

        raise UsageError(describe_usage_error(error, words)) from error
    if code == EXIT_INTERRUPTED:
        raise KeyboardInterrupt  # typer has caught it
    return code if isinstance(code, int) else EXIT_OK


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


def _placeholder() -> int:
    """Stand for a command that is listed in help texts and completions, but not imported."""
    raise UsageError('a command is the first word; see kitti-ros2 --help')


def _import_command(name: str) -> Callable[..., int]:
    """Return the function of a command, with its options."""
    module, _ = _COMMANDS[name]
    function = re.sub('[ -]', '_', name)
    command: Callable[..., int] = getattr(import_module(f'.{module}', __package__), function)
    add_options(command)
    return command


# Errors of the parser of arguments: misspelt commands and options, missing arguments.

_NO_COMMAND = re.compile(r"No such command '(.*?)'")
_EXTRA = re.compile(r'Got unexpected extra argument\S* \((.*)\)')
_NO_NUMBER = re.compile(r"Invalid value for '(\S+)'.*: (.+) is not a valid (?:float|int)")


def describe_usage_error(error: Any, words: Sequence[str]) -> str:  # noqa: ANN401 - of typer's own copy of click
    """Describe an error of typer's parser in one line, with a correction or the usage."""
    message = error.format_message().rstrip('.')
    context = getattr(error, 'ctx', None)
    if context is None:
        command_words = words[: 2 if words[0] == 'eval' else 1]
        return f'{message}; see {" ".join(["kitti-ros2", *command_words])} --help'
    command, path = context.command, context.command_path
    unknown = _NO_COMMAND.match(message)
    if unknown is not None:
        return _no_command(unknown[1], list(command.commands))
    kind = type(error).__name__  # its class cannot be imported from all versions of typer
    if kind == 'NoSuchOption':
        hint = _hint_of_option(error.option_name, _spellings(command))
        message = f'there is no option {error.option_name}{hint}'
        return f'{message} See {path} --help' if hint else f'{message}; {_usage(command, path)}'
    if kind == 'MissingParameter':
        return missing_argument(error.param, context)
    extra = _EXTRA.match(message)
    if extra is not None:
        several = ' ' in extra[1] and '--all' in _spellings(command)
        hint = '; for several recordings quote the pattern and give --all' if several else ''
        return f'unexpected argument {extra[1]}{hint}; {_usage(command, path)}'
    number = _NO_NUMBER.match(message)
    if number is not None:
        message = f'{number[1]} takes a number, not {number[2]}'
    return f'{message}; see {path} --help'


def missing_argument(argument: Any, context: Any) -> str:  # noqa: ANN401 - as above
    """Describe a missing argument, with the usage of its command."""
    meaning = argument.help.rstrip('.')
    usage = _usage(context.command, context.command_path)
    return f'{_name(argument)} is missing ({meaning[:1].lower()}{meaning[1:]}); {usage}'


def _usage(command: Any, path: str) -> str:  # noqa: ANN401 - as above
    names = command.collect_usage_pieces(None)[1:] if isinstance(command, Command) else []
    return f'usage: {" ".join([path, *names])} [OPTIONS]'


def _name(argument: Any) -> str:  # noqa: ANN401 - as above
    name: str = argument.metavar or argument.name.upper()
    return name


def _spellings(command: Any) -> list[str]:  # noqa: ANN401 - as above
    flags = [flag for param in command.params for flag in (*param.opts, *param.secondary_opts)]
    named = any(param.name == 'out' for param in command.params)
    return [*flags, *OUT_FLAGS] if named else flags


_CONVERT = 'to-bag writes a folder or a bag as a bag, to-kitti writes KITTI files'
_SCORED = ('detection', 'odometry', 'tracking', 'live')
_OTHER_NAMES = {
    **dict.fromkeys(('convert', 'export', 'import'), _CONVERT),
    **dict.fromkeys(('show', 'plot', 'draw', 'visualize'), 'did you mean view?'),
    **dict.fromkeys(('score', 'evaluate', 'benchmark'), 'did you mean eval?'),
    **{word: f'did you mean eval {word}?' for word in _SCORED},
    'check': 'did you mean validate?',
    'repair': 'did you mean recover?',
    'unzip': 'did you mean extract?',
    'get': 'did you mean download?',
}
"""What to answer to words that are no commands."""
_OTHER_OPTIONS = {
    **dict.fromkeys(('--format', '--type', '--dataset'), '--layout'),
    '--drive': '--sequence',
    **dict.fromkeys(('--min-overlap', '--overlap', '--threshold'), '--iou'),
    **dict.fromkeys(('--workers', '--threads', '-j'), '--jobs'),
    **dict.fromkeys(('--force', '-f'), '--overwrite'),
    **dict.fromkeys(('--split', '--max-size', '--max-bag-size', '-b'), '--split-size'),
    **dict.fromkeys(('--output-dir', '--output-folder', '-O'), '--out'),
    '--max-bag-duration': '--split-duration',
    '--frames': '--start',
    '--speed': '--rate',
    '-c': '--compression',
    '-v': '--version',
}
"""Options of other programs, and those of ours that mean the same."""


def _hint_of_option(name: str, spellings: list[str]) -> str:
    other = _OTHER_OPTIONS.get(name)
    return f'; did you mean {other}?' if other in spellings else did_you_mean(name, spellings)


def _no_command(word: str, names: list[str]) -> str:
    hint = f'; {_OTHER_NAMES[word]}' if word in _OTHER_NAMES else did_you_mean(word, names)
    if not hint and Path(word).exists():
        hint = f'; give a command first, such as kitti-ros2 info {word}'
    listed = ', '.join(names)
    return f'there is no command {word}{hint or f"; there are {listed}"}'


def missing_path(path: str, words: Sequence[str]) -> str:
    """Describe a missing path among the words: the option that it was given to, names like it."""
    before = words[max(words.index(path) - 1, 0)]
    option = f'; {before} takes one that exists' if before.startswith('-') else ''
    place = Path(path)
    close: list[str] = []
    with suppress(OSError):
        close = close_names(place.name, [entry.name for entry in place.parent.iterdir()])
    hint = f'; did you mean {either([str(place.with_name(name)) for name in close])}?'
    return f'{path}: no such file or folder{hint if close else option}'


# Corrected commands, made from the words of the one that failed.

_PROGRAM = 'kitti-ros2'
_ROS_ARGS = '--ros-args'
_FOLDER, _NAME = 'd', 's'
"""Variables of shell loops: over folders, over the names of sequences."""


def format_remedies(remedies: Sequence[Remedy], words: Sequence[str]) -> str:
    """Format the commands of remedies, joined by or; '' if the source is not among the words.

    Args:
        remedies: Remedies of an error.
        words: The arguments of the command line.
    """
    usable = [remedy for remedy in remedies if _word_index(words, remedy.given) is not None]
    return ' or '.join(_format(remedy, list(words)) for remedy in usable)


def _format(remedy: Remedy, words: list[str]) -> str:
    params = _arguments(words)
    if remedy.command and remedy.command != words[0]:
        command = _other_command(remedy, params)
    else:
        command = _same_command(remedy, words, params)
    if remedy.before:
        return f'{remedy.before} && {command}'
    if not remedy.loop:
        return command
    variable = _NAME if remedy.by_name else _FOLDER
    return f'all: for {variable} in {remedy.loop}; do {command}; done'


def _same_command(remedy: Remedy, words: list[str], params: dict[str, Any]) -> str:
    """Return the command with another source, and with an output of its own in a loop."""
    changed = [shlex.quote(word) for word in words]
    index = _word_index(words, remedy.given)
    if index is not None:
        over_folders = remedy.loop and not remedy.by_name
        changed[index] = f'"${_FOLDER}"' if over_folders else shlex.quote(str(remedy.source))
    added = [shlex.quote(word) for word in remedy.options]
    if remedy.frame is not None and words[0] == 'view' and not {'--frame', '--frames'} & {*words}:
        added += ['--frame', str(remedy.frame)]
    if remedy.loop and remedy.by_name:
        added += ['--sequence', f'"${_NAME}"']
    out = params.get('out') or params.get('save')
    if remedy.loop and out is not None:
        name, at = (
            _output_of_each(as_path(out), by_name=remedy.by_name),
            _word_index(words, as_path(out)),
        )
        if at is None:
            added += ['-o', name]
        else:
            changed[at] = name
    end = changed.index(_ROS_ARGS) if _ROS_ARGS in changed else len(changed)
    return ' '.join([_PROGRAM, *changed[:end], *added, *changed[end:]])


def _output_of_each(out: Path, *, by_name: bool) -> str:
    """Return the output of a loop's command: in the same folder, with the same ending."""
    folder = '' if out.parent == Path() else f'{shlex.quote(str(out.parent))}/'
    name = f'${_NAME}' if by_name else f'$(basename "${_FOLDER}")'
    return f'{folder}"{name}{out.suffix}"'


def _other_command(remedy: Remedy, params: dict[str, Any]) -> str:
    """Return another command for the source, with an output that is like the one given."""
    words = [remedy.command, str(remedy.source), *remedy.options]
    if remedy.command != 'play':
        out = as_path(params.get('out') or params['paths'][-1])
        if out == remedy.given:  # OUT was not needed
            out = Path(remedy.source.absolute().name)
        words.insert(2, _output_for(remedy, out))
    return shlex.join([_PROGRAM, *words])


def _output_for(remedy: Remedy, out: Path) -> str:
    suffixes = {container.suffix for container in CONTAINERS.values()}
    if remedy.command == 'to-kitti':
        return str(out.with_suffix('')) if out.suffix in suffixes else str(out)
    return str(out) if out.suffix in suffixes else f'{out}.mcap'


def _word_index(words: Sequence[str], path: Path) -> int | None:
    """Return the index of the word that is a path."""
    for index, word in enumerate(words[1:], 1):
        if word and as_path(word).expanduser() == path.expanduser():
            return index
    return None


def _arguments(words: list[str]) -> dict[str, Any]:
    """Parse the arguments of a command line that was parsed before."""
    words = words[: words.index(_ROS_ARGS)] if _ROS_ARGS in words else words
    with suppress(Exception):  # typer has its own kinds of errors
        name, command = find_command(words)
        rest = words[len(name.split()) :]
        params: dict[str, Any] = command.make_context(name, rest).params
        return params
    return {}
