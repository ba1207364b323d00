# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the files of a stack for a drive: parameters and a launch file; returns its commands."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..bags.open_source import open_folder
from ..files.local_staging import Staging
from ..files.output_rules import keep_all_but_files, refusal_of
from ..files.remote import as_path
from ..files.staging import staged_file
from ..kitti.extract_oxts import add_extract
from ..model.streams import Stream
from ..options.stack_catalogue import Node
from ..options.stack_names import IMU
from .parameter_files import WRITTEN, facts_of, parameter_texts

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from ..model.recording import ReadableRecording
    from ..options.stack_catalogue import LaunchFile, Stack
    from ..options.table import Settings


# The commands of a run: play, record, score.

_ALWAYS_RECORDED = ('/tf', '/tf_static')
_OF_TRUTH = {'layout', 'sequence'}
"""Options of a recording that choose its poses."""


@dataclass(frozen=True)
class RunCommands:
    """The commands of a run, in the order of their use; '' for none.

    Attributes:
        record: Recording, in another terminal before the run.
        run: The stack, and the player of the drive.
        score: Evaluation after the run.
    """

    record: str
    run: str
    score: str


def play_words(stack: Stack, drive: str, source: Mapping[str, object]) -> list[str]:
    """Return the words of the command that plays a drive for a stack.

    Args:
        stack: The stack.
        drive: The path of the drive.
        source: Options of the recording, such as sequence and imu_from.
    """
    return ['kitti-ros2', 'play', drive, *_words(source), '--for', stack.name]


def commands_of(
    stack: Stack, drive: str, source: Mapping[str, object], folder: str = ''
) -> RunCommands:
    """Return the commands of a run.

    Args:
        stack: The stack.
        drive: The path of the drive.
        source: Options of the recording, such as sequence and imu_from.
        folder: The folder of its parameter and launch files; '' for none.
    """
    play = shlex.join(play_words(stack, drive, source))
    run = f'ros2 launch {shlex.quote(f"{folder}/{stack.name}.launch.py")}' if folder else play
    return RunCommands(_record(stack), run, _score(stack, drive, source))


def _record(stack: Stack) -> str:
    if not stack.result.topics and not stack.result.tf:
        return ''
    topics = [*stack.result.topics, *_ALWAYS_RECORDED]
    return shlex.join(['ros2', 'bag', 'record', '-o', _bag(stack), '--use-sim-time', *topics])


def _score(stack: Stack, drive: str, source: Mapping[str, object]) -> str:
    """Return the command that scores the trajectory, with names missing in messages."""
    result = stack.result
    if not (result.odometry or result.file or result.tf):
        return ''
    truth = {name: value for name, value in source.items() if name in _OF_TRUTH}
    words = ['kitti-ros2', 'eval', 'odometry', drive, result.file or _bag(stack), *_words(truth)]
    words += ['--topic', result.odometry] if result.odometry else []
    words += ['--frame', result.frame] if result.frame else []
    words += ['--tf', *result.tf] if result.tf else []
    return shlex.join(words)


def _words(options: Mapping[str, object]) -> list[str]:
    pairs = ((f'--{name.replace("_", "-")}', str(value)) for name, value in options.items())
    return [word for pair in pairs for word in pair]


def _bag(stack: Stack) -> str:
    return f'{stack.name}_run'


# The text of a launch file: the stack, and the player of a drive.

_DELAY_S = 5
_COLUMNS = 90
_DIR = '{dir}'
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
"""The module of each name of a launch file."""
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
    """An unquoted expression."""

    text: str


def launch_text(stack: Stack, play: Sequence[str], parameters: Sequence[str]) -> str:
    """Return the text of a launch file.

    Args:
        stack: The stack to start.
        play: Words of the command that plays it.
        parameters: Names of the parameter files beside the launch file.
    """
    command = [*play, '--delay', str(_DELAY_S), '--no-keyboard']
    player = _Call('ExecuteProcess', (), {'cmd': command, 'output': 'screen'})
    actions: list[object] = [_Call('SetParameter', ('use_sim_time', True))]
    for action in stack.launch:
        if isinstance(action, Node):
            actions.append(_node(action, parameters))
        else:
            actions += _included(action)
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
        imported = [name for name in names if name in called]
        if imported:
            bare = f'from {module} import {", ".join(imported)}'
            long = len(bare) > _COLUMNS
            lines.append(_joined(f'from {module} import (', imported, ')', 0) if long else bare)
    return '\n'.join(lines)


def _node(node: Node, parameters: Sequence[str]) -> _Call:
    settings: list[object] = [
        _text_or_path(f'{_DIR}/{parameter}') for parameter in parameters if node.parameters
    ]
    if node.values:
        settings.append({name: _text_or_path(value) for name, value in node.values.items()})
    words: dict[str, object] = {
        'package': node.package,
        **({'plugin': node.component} if node.component else {'executable': node.executable}),
        'name': node.name,
        'parameters': settings,
        'remappings': [*node.remappings.items()],
        'arguments': [*map(_text_or_path, node.arguments)],
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


def _included(included: LaunchFile) -> list[object]:
    variables = [_Call('SetEnvironmentVariable', pair) for pair in included.environment.items()]
    share = _Call('FindPackageShare', (included.package,))
    file = _Call('PathJoinSubstitution', ([share, included.file],))
    arguments = [(name, _text_or_path(value)) for name, value in included.arguments.items()]
    words = {'launch_arguments': arguments} if arguments else {}
    source = _Call('AnyLaunchDescriptionSource', (file,))
    return [*variables, _Call('IncludeLaunchDescription', (source,), words)]


def _text_or_path(text: str) -> object:
    """Return a text, or the expression of a path that begins with {dir}."""
    if text == _DIR:
        return _Code('str(HERE)')
    if text.startswith(f'{_DIR}/'):
        return _Code(f'str(HERE / {text.removeprefix(f"{_DIR}/")!r})')
    return text


def _written(value: object, depth: int) -> str:
    """Return an expression as Python source, on several lines if it is long."""
    if isinstance(value, _Call):
        parts = [_written(part, depth + 1) for part in value.values]
        parts += [f'{word}={_written(part, depth + 1)}' for word, part in value.words.items()]
        return _joined(f'{value.name}(', parts, ')', depth)
    if isinstance(value, _Code):
        return value.text
    if isinstance(value, list):
        return _joined('[', [_written(element, depth + 1) for element in value], ']', depth)
    if isinstance(value, tuple):
        return f'({", ".join(_written(element, depth + 1) for element in value)})'
    if isinstance(value, dict):
        pairs = [f'{key!r}: {_written(element, depth + 1)}' for key, element in value.items()]
        return _joined('{', pairs, '}', depth)
    return repr(value)


def _joined(start: str, parts: Sequence[str], end: str, depth: int) -> str:
    line = start + ', '.join(parts) + end
    if len(line) + 4 * depth <= _COLUMNS and '\n' not in line:
        return line
    margin = '    ' * (depth + 1)
    lines = ''.join(f'{margin}{part},\n' for part in parts)
    return f'{start}\n{lines}{"    " * depth}{end}'


_OWN_FILES = keep_all_but_files('parameter file', [WRITTEN.encode(), b'%YAML:1.0', b'{'])


@dataclass(frozen=True)
class Setup:
    """The written files of a stack.

    Attributes:
        files: The parameter files, and the launch file last.
        commands: The commands of a run.
        notes: Facts missing in the files of the drive.
    """

    files: tuple[Path, ...]
    commands: RunCommands
    notes: tuple[str, ...]


def write_setup(
    stack: Stack,
    drive: Path,
    folder: Path,
    settings: Settings,
    source: Mapping[str, object],
    *,
    overwrite: bool,
) -> Setup:
    """Write the files of a stack for a drive into a folder.

    Args:
        stack: The stack.
        drive: The KITTI folder.
        folder: The folder; created if missing.
        settings: Options for reading the drive and its 100 Hz packets.
        source: The options of these that the user set, for the player.
        overwrite: True replaces files of the same names that this wrote.

    Raises:
        KittiRos2Error, OSError: The drive cannot be read, or a file exists; none is written.
    """
    recording = open_folder(drive, settings.read)
    add_extract(recording, settings.imu)
    facts, notes = facts_of(recording)
    notes += tuple(_imu_notes(stack, recording, facts.imu_hz))
    play = play_words(stack, str(drive.resolve()), _absolute(source))
    texts = parameter_texts(stack, facts, drive)
    texts[f'{stack.name}.launch.py'] = launch_text(stack, play, [*texts])
    refusal = refusal_of(_OWN_FILES, overwrite=overwrite)
    for name in texts:
        Staging(folder / name, refusal).discard()  # an error comes before the first write
    for name, text in texts.items():
        with staged_file(folder / name, refusal) as path:
            path.write_text(text, 'utf-8')
    commands = commands_of(stack, str(drive), source, str(folder))
    return Setup(tuple(folder / name for name in texts), commands, notes)


def _imu_notes(stack: Stack, recording: ReadableRecording, rate_hz: float) -> list[str]:
    topic = stack.topics.get(IMU, IMU)
    if {Stream.OXTS, Stream.OXTS_EXTRACT} & recording.streams.keys():
        return stack.imu_notes(topic, rate_hz)
    missing = f'{stack.name} reads {topic}: {recording.name} has no packets of the GPS/IMU unit'
    return [missing] if stack.imu_hz else []


def _absolute(source: Mapping[str, object]) -> dict[str, object]:
    return {
        name: str(as_path(str(value)).resolve()) if name == 'imu_from' else value
        for name, value in source.items()
    }
