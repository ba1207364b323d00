# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The text of a launch file: the stack, and the player of a drive."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..stacks.stack import Node

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..stacks.stack import Included, Stack

WRITTEN = '# Written by kitti-ros2 stacks'
"""Beginning of the files that may be written again."""
_DELAY_S = 5
_COLUMNS = 90
_PLACE = '{dir}'
_IMPORTS = (
    ('launch', ('LaunchDescription',)),
    (
        'launch.actions',
        (
            'ExecuteProcess',
            'IncludeLaunchDescription',
            'RegisterEventHandler',
            'SetEnvironmentVariable',
            'Shutdown',
        ),
    ),
    ('launch.event_handlers', ('OnProcessExit',)),
    ('launch.launch_description_sources', ('AnyLaunchDescriptionSource',)),
    ('launch.substitutions', ('PathJoinSubstitution',)),
    ('launch_ros.actions', ('ComposableNodeContainer', 'Node', 'SetParameter')),
    ('launch_ros.descriptions', ('ComposableNode',)),
    ('launch_ros.substitutions', ('FindPackageShare',)),
)
"""Where each name of a launch file is from."""
_TEMPLATE = '''{written}.
"""Starts {stack}, and plays a drive of KITTI for it."""

from pathlib import Path

{imports}

HERE = Path(__file__).resolve().parent


def generate_launch_description():
    """Start the stack, then the player; the end of the drive ends both."""
    player = {player}
    return {description}
'''


@dataclass(frozen=True)
class _Call:
    """A call in the text: a name, arguments by position, and arguments by name."""

    name: str
    values: tuple[object, ...] = ()
    words: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class _Code:
    """An expression as it is."""

    text: str


def launch_text(stack: Stack, play: Sequence[str], parameters: Sequence[str]) -> str:
    """Return the text of a launch file.

    Args:
        stack: What it starts.
        play: Words of the command that plays it.
        parameters: Names of the parameter files beside the launch file.
    """
    command = [*play, '--delay', str(_DELAY_S), '--no-keyboard']
    player = _Call('ExecuteProcess', (), {'cmd': command, 'output': 'screen'})
    actions: list[object] = [_Call('SetParameter', ('use_sim_time', True))]
    for each in stack.launch:
        if isinstance(each, Node):
            actions.append(_node(each, parameters))
        else:
            actions += _included(each)
    ending = {'target_action': _Code('player'), 'on_exit': [_Call('Shutdown')]}
    stop = _Call('RegisterEventHandler', (_Call('OnProcessExit', (), ending),))
    description = _Call('LaunchDescription', ([*actions, _Code('player'), stop],))
    texts = {'player': _written(player, 1), 'description': _written(description, 1)}
    return _TEMPLATE.format(
        written=WRITTEN,
        stack=stack.name,
        imports=_imports(' '.join(texts.values())),
        **texts,
    )


def _imports(text: str) -> str:
    """Return the imports of the names that a text calls."""
    called = set(re.findall(r'(\w+)\(', text))
    lines = []
    for module, names in _IMPORTS:
        found = [each for each in names if each in called]
        if found:
            bare = f'from {module} import {", ".join(found)}'
            long = len(bare) > _COLUMNS
            lines.append(_joined(f'from {module} import (', found, ')', 0) if long else bare)
    return '\n'.join(lines)


def _node(node: Node, parameters: Sequence[str]) -> _Call:
    given: list[object] = [_place(f'{_PLACE}/{each}') for each in parameters if node.parameters]
    if node.values:
        given.append({name: _place(value) for name, value in node.values.items()})
    words: dict[str, object] = {
        'package': node.package,
        **({'plugin': node.component} if node.component else {'executable': node.executable}),
        'name': node.name,
        'parameters': given,
        'remappings': [*node.remappings.items()],
        'arguments': [*map(_place, node.arguments)],
        'output': '' if node.component else 'screen',
    }
    inner = _Call(
        'ComposableNode' if node.component else 'Node',
        (),
        {word: value for word, value in words.items() if value},
    )
    if not node.component:
        return inner
    outer = {
        'package': 'rclcpp_components',
        'executable': 'component_container',
        'name': f'{node.name}_container',
        'namespace': '',
        'composable_node_descriptions': [inner],
        'output': 'screen',
    }
    return _Call('ComposableNodeContainer', (), outer)


def _included(included: Included) -> list[object]:
    variables = [_Call('SetEnvironmentVariable', pair) for pair in included.environment.items()]
    share = _Call('FindPackageShare', (included.package,))
    file = _Call('PathJoinSubstitution', ([share, included.file],))
    arguments = [(name, _place(value)) for name, value in included.arguments.items()]
    words = {'launch_arguments': arguments} if arguments else {}
    source = _Call('AnyLaunchDescriptionSource', (file,))
    return [*variables, _Call('IncludeLaunchDescription', (source,), words)]


def _place(text: str) -> object:
    """Return a text, or the expression of a path that begins with {dir}."""
    if text == _PLACE:
        return _Code('str(HERE)')
    if text.startswith(f'{_PLACE}/'):
        return _Code(f'str(HERE / {text.removeprefix(f"{_PLACE}/")!r})')
    return text


def _written(value: object, depth: int) -> str:
    """Return an expression as Python writes it, on several lines if it is long."""
    if isinstance(value, _Call):
        parts = [_written(each, depth + 1) for each in value.values]
        parts += [f'{word}={_written(each, depth + 1)}' for word, each in value.words.items()]
        return _joined(f'{value.name}(', parts, ')', depth)
    if isinstance(value, _Code):
        return value.text
    if isinstance(value, list):
        return _joined('[', [_written(each, depth + 1) for each in value], ']', depth)
    if isinstance(value, tuple):
        return f'({", ".join(_written(each, depth + 1) for each in value)})'
    if isinstance(value, dict):
        pairs = [f'{key!r}: {_written(each, depth + 1)}' for key, each in value.items()]
        return _joined('{', pairs, '}', depth)
    return repr(value)


def _joined(start: str, parts: Sequence[str], end: str, depth: int) -> str:
    line = start + ', '.join(parts) + end
    if len(line) + 4 * depth <= _COLUMNS and '\n' not in line:
        return line
    margin = '    ' * (depth + 1)
    lines = ''.join(f'{margin}{part},\n' for part in parts)
    return f'{start}\n{lines}{"    " * depth}{end}'
