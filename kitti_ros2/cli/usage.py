# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the parser of arguments: misspelt commands and options, missing arguments."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ..model.spelling import did_you_mean

_NO_COMMAND = re.compile(r"No such command '(.*?)'")
_EXTRA = re.compile(r'Got unexpected extra argument\S* \((.*)\)')


def describe_usage_error(error: Any) -> str:  # noqa: ANN401 - of typer's own copy of click
    """Describe an error of typer's parser in one line, with a correction or the usage."""
    message = error.format_message().rstrip('.')
    context = getattr(error, 'ctx', None)
    if context is None:
        return f'{message}; see kitti-ros2 --help'
    command, path = context.command, context.command_path
    unknown = _NO_COMMAND.match(message)
    if unknown is not None:
        return _no_command(unknown[1], list(command.commands))
    kind = type(error).__name__  # its class cannot be imported from all versions of typer
    if kind == 'NoSuchOption':
        hint = did_you_mean(error.option_name, _spellings(command))
        message = f'there is no option {error.option_name}{hint}'
        return f'{message} See {path} --help' if hint else f'{message}; {_usage(command, path)}'
    if kind == 'MissingParameter':
        return missing_argument(error.param, context)
    extra = _EXTRA.match(message)
    if extra is not None:
        return f'unexpected argument {extra[1]}; {_usage(command, path)}'
    return f'{message}; see {path} --help'


def missing_argument(argument: Any, context: Any) -> str:  # noqa: ANN401 - as above
    """Describe a missing argument, with the usage of its command."""
    meaning = argument.help.rstrip('.')
    usage = _usage(context.command, context.command_path)
    return f'{_name(argument)} is missing ({meaning[:1].lower()}{meaning[1:]}); {usage}'


def _usage(command: Any, path: str) -> str:  # noqa: ANN401 - as above
    names = [
        _name(each) if each.required else f'[{_name(each)}]'
        for each in command.params
        if each.param_type_name == 'argument'
    ]
    return f'usage: {" ".join([path, *names])} [OPTIONS]'


def _name(argument: Any) -> str:  # noqa: ANN401 - as above
    name: str = argument.metavar or argument.name.upper()
    return name


def _spellings(command: Any) -> list[str]:  # noqa: ANN401 - as above
    return [flag for each in command.params for flag in (*each.opts, *each.secondary_opts)]


def _no_command(word: str, known: list[str]) -> str:
    hint = did_you_mean(word, known)
    if not hint and Path(word).exists():
        hint = f'; give a command first, such as kitti-ros2 info {word}'
    listed = ', '.join(known)
    return f'there is no command {word}{hint or f"; there are {listed}"}'
