# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The commands that do what was meant, made from the words of the one that failed."""

from __future__ import annotations

import shlex
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.remote import as_path
from ..model.containers import CONTAINERS
from .app import find_command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..model.errors import Remedy

_PROGRAM = 'kitti-ros2'
_ROS_ARGS = '--ros-args'
_FOLDER, _NAME = 'd', 's'
"""The variables of shell loops: over folders, over the names of sequences."""


def format_remedies(remedies: Sequence[Remedy], words: Sequence[str]) -> str:
    """Format the commands of remedies, joined by or; '' if the source is not among the words.

    Args:
        remedies: Those of an error.
        words: The arguments of the command line.
    """
    known = [each for each in remedies if _place(words, each.given) is not None]
    return ' or '.join(_format(each, list(words)) for each in known)


def _format(remedy: Remedy, words: list[str]) -> str:
    given = _arguments(words)
    if remedy.command and remedy.command != words[0]:
        command = _other_command(remedy, given)
    else:
        command = _same_command(remedy, words, given)
    if remedy.before:
        return f'{remedy.before} && {command}'
    if not remedy.each:
        return command
    variable = _NAME if remedy.by_name else _FOLDER
    return f'all: for {variable} in {remedy.each}; do {command}; done'


def _same_command(remedy: Remedy, words: list[str], given: dict[str, Any]) -> str:
    """Return the command with another source, and with an output of its own in a loop."""
    changed = [shlex.quote(word) for word in words]
    place = _place(words, remedy.given)
    if place is not None:
        over_folders = remedy.each and not remedy.by_name
        changed[place] = f'"${_FOLDER}"' if over_folders else shlex.quote(str(remedy.source))
    added = [shlex.quote(word) for word in remedy.options]
    if remedy.frame is not None and words[0] == 'view' and not {'--frame', '--frames'} & {*words}:
        added += ['--frame', str(remedy.frame)]
    if remedy.each and remedy.by_name:
        added += ['--sequence', f'"${_NAME}"']
    out = given.get('out') or given.get('save')
    if remedy.each and out is not None:
        name, at = (
            _output_of_each(as_path(out), by_name=remedy.by_name),
            _place(words, as_path(out)),
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


def _other_command(remedy: Remedy, given: dict[str, Any]) -> str:
    """Return another command for the source, with an output that is like the one given."""
    words = [remedy.command, str(remedy.source), *remedy.options]
    if remedy.command != 'play':
        out = as_path(given.get('out') or given['paths'][-1])
        if out == remedy.given:  # OUT was not needed
            out = Path(remedy.source.absolute().name)
        words.insert(2, _output_for(remedy, out))
    return shlex.join([_PROGRAM, *words])


def _output_for(remedy: Remedy, out: Path) -> str:
    suffixes = {container.suffix for container in CONTAINERS.values()}
    if remedy.command == 'to-kitti':
        return str(out.with_suffix('')) if out.suffix in suffixes else str(out)
    return str(out) if out.suffix in suffixes else f'{out}.mcap'


def _place(words: Sequence[str], path: Path) -> int | None:
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
        found: dict[str, Any] = command.make_context(name, rest).params
        return found
    return {}
