# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of the commands, their options and exit codes."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path
from textwrap import dedent
from typing import Any

from markdown_tables import code, table

from kitti_ros2.cli.app import find_command
from kitti_ros2.cli.command import CONFIG_ONLY

ROOT = Path(__file__).resolve().parents[1]
_DEFAULT = re.compile(r'\s*\[default: (.*)\]$')


def command(*words: str) -> str:
    """Return the description, the arguments and the options of a command."""
    name, found = find_command([*words])
    arguments = [each for each in found.params if each.param_type_name == 'argument']
    options = [each for each in found.params if each.param_type_name == 'option']
    names = ' '.join(found.collect_usage_pieces(None)[1:])
    usage = f'```text\nkitti-ros2 {name} {names} [OPTIONS]\n```'
    about = table(
        ('argument', 'meaning'),
        ((code(each.metavar or each.name.upper()), each.help) for each in arguments),
    )
    parts = [inspect.cleandoc(found.help), usage, about]
    panels: dict[str, list[Any]] = {'': []}
    for each in options:
        panels.setdefault(getattr(each, 'rich_help_panel', None) or '', []).append(each)
    for title, members in panels.items():
        rows = [_option_row(each) for each in members]
        parts += [f'**{title}**'] if title else []
        parts += [table(('option', 'value', 'meaning', 'default'), rows)] if rows else []
    examples = inspect.cleandoc(found.callback.__doc__ or '').partition('Examples:\n')[2]
    parts += [f'```text\n{dedent(examples).strip()}\n```'] if examples else []
    return '\n\n'.join(parts)


def _option_row(option: Any) -> tuple[str, ...]:  # noqa: ANN401 - of typer's own copy of click
    spellings = [*option.opts, *option.secondary_opts]
    if option.rich_help_panel == CONFIG_ONLY:
        spellings = [option.name]
    text = option.help or ''
    declared = _DEFAULT.search(text)
    default = declared[1] if declared else _plain_default(option)
    value = '' if option.is_flag else option.metavar or _kind(option.type)
    if value.startswith('['):
        value = value.strip('[]').replace('|', ', ')
    return ', '.join(map(code, spellings)), value, _DEFAULT.sub('', text), default


def _plain_default(option: Any) -> str:  # noqa: ANN401
    if isinstance(option.default, bool):
        return 'on' if option.default else 'off'
    if option.is_flag:
        return 'off'
    return '' if option.default is None or callable(option.default) else str(option.default)


def _kind(kind: Any) -> str:  # noqa: ANN401
    choices = getattr(kind, 'choices', None)
    names = {'str': 'text', 'int': 'number', 'float': 'number'}
    return ', '.join(map(str, choices)) if choices else names.get(kind.name, str(kind.name))


def exit_codes() -> str:
    """Return the exit codes, from the constants and the texts below them."""
    tree = ast.parse((ROOT / 'kitti_ros2/cli/exits.py').read_text('utf-8'))
    rows = [
        (str(number.value.value), str(text.value.value))
        for number, text in zip(tree.body[1:], tree.body[2:], strict=False)
        if isinstance(number, ast.Assign)
        and isinstance(number.value, ast.Constant)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
    ]
    return table(('exit code', 'meaning'), rows)
