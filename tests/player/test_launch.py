# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which value of a parameter launch/player.launch.py starts the node with.

ROS's launch is in no wheel: stand-ins record what the launch file says, and what it says goes to
rclpy the way launch_ros hands it over, as one --params-file after the other.
"""

import runpy
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
import yaml

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

import rclpy

from kitti_ros2.player.node import KittiPlayer

ROOT = Path(__file__).resolve().parents[2]
SHARE = str(ROOT)
ARGUMENTS = {
    'source': ('/of/the/argument', '/of/the/argument'),
    'sequence': ('0007', '0007'),
    'imu_from': ('/of/the/extract', '/of/the/extract'),
    'rate': ('3.5', 3.5),
    'loop': ('4', 4),
    'start_paused': ('false', False),
    'clock': ('20', 20.0),
}
"""Of each the word on the command line, and the value that it means."""
IN_FILE = {
    'source': '/of/the/file',
    'sequence': '0001',
    'imu_from': '/of/the/other',
    'rate': 2.0,
    'loop': 3,
    'start_paused': True,
    'clock': 7.0,
}


@dataclass
class Recorded:
    """A call of launch: its arguments."""

    words: tuple
    options: dict


@dataclass
class Context:
    """What launch knows while it runs."""

    launch_configurations: dict = field(default_factory=dict)


class Substitution:
    def __init__(self, perform):
        self.perform = perform


def recorder(kind):
    return type(kind, (Recorded,), {'__init__': _record})


def _record(self, *words, **options):
    Recorded.__init__(self, words, options)


def joined(parts):
    return Substitution(lambda context: '/'.join(text_of(part, context) for part in parts))


def text_of(part, context):
    return part.perform(context) if isinstance(part, Substitution) else part


@pytest.fixture
def launch(monkeypatch):
    """A function that launches player.launch.py with arguments; returns its nodes by name."""
    kinds = {
        'launch': {'LaunchDescription': list, 'LaunchContext': Context},
        'launch.actions': {
            'DeclareLaunchArgument': recorder('DeclareLaunchArgument'),
            'OpaqueFunction': recorder('OpaqueFunction'),
        },
        'launch.conditions': {'IfCondition': recorder('IfCondition')},
        'launch.substitutions': {
            'LaunchConfiguration': lambda name: Substitution(
                lambda context: context.launch_configurations[name]
            ),
            'PathJoinSubstitution': joined,
        },
        'launch_ros': {},
        'launch_ros.actions': {'Node': recorder('Node')},
        'launch_ros.parameter_descriptions': {'ParameterValue': recorder('ParameterValue')},
        'launch_ros.substitutions': {
            'FindPackageShare': lambda _: Substitution(lambda _: SHARE),
        },
    }
    for name, members in kinds.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    names = runpy.run_path(str(ROOT / 'launch' / 'player.launch.py'))

    def run(**arguments):
        context, nodes = Context(dict(arguments)), {}
        actions = list(names['generate_launch_description']())
        while actions:
            action = actions.pop(0)
            kind = type(action).__name__
            if kind == 'DeclareLaunchArgument':
                default = text_of(action.options['default_value'], context)
                context.launch_configurations.setdefault(action.words[0], default)
            elif kind == 'OpaqueFunction':
                actions = [*action.options['function'](context), *actions]
            else:
                nodes[action.options['executable']] = action
        return SimpleNamespace(nodes=nodes, context=context)

    return run


def parameter_files(launched, folder):
    """What launch_ros writes: a dictionary becomes a file for any node."""
    files = []
    for place, entry in enumerate(launched.nodes['player'].options['parameters']):
        if isinstance(entry, dict):
            path = folder / f'launch_params_{place}'
            values = {name: typed(value) for name, value in entry.items()}
            path.write_text(yaml.dump({'/**': {'ros__parameters': values}}), 'utf-8')
            files.append(str(path))
        else:
            files.append(text_of(entry, launched.context))
    return files


def typed(value):
    """As ParameterValue does it: YAML, which must be of the type."""
    text, kind = value.words[0], value.options['value_type']
    made = text if kind is str else yaml.safe_load(text)
    return kind(made)


def values_of(launched, folder):
    """The node's parameters."""
    files = parameter_files(launched, folder)
    words = [word for path in files for word in ('--params-file', path)]
    context = rclpy.Context()
    rclpy.init(args=['player', '--ros-args', *words], context=context)
    try:
        node = KittiPlayer(context=context)
        values = dict(node._values)
        node.destroy_node()
    finally:
        context.try_shutdown()
    return values


@pytest.fixture(params=['kitti_player', '/**'])
def params_file(request, tmp_path):
    """A user's file, for the node or for any."""
    path = tmp_path / 'mine.yaml'
    path.write_text(yaml.dump({request.param: {'ros__parameters': IN_FILE}}), 'utf-8')
    return str(path)


def test_every_argument_is_tried(launch):
    configurations = launch().context.launch_configurations
    assert set(configurations) == {*ARGUMENTS, 'params_file', 'rviz', 'rviz_config'}


def test_the_file_wins_over_the_defaults(launch, params_file, tmp_path):
    values = values_of(launch(params_file=params_file), tmp_path)
    assert {name: values[name] for name in IN_FILE} == IN_FILE


@pytest.mark.parametrize('name', ARGUMENTS)
def test_an_argument_that_is_given_wins_over_the_file(launch, params_file, tmp_path, name):
    word, value = ARGUMENTS[name]
    values = values_of(launch(params_file=params_file, **{name: word}), tmp_path)
    assert {key: values[key] for key in IN_FILE} == {**IN_FILE, name: value}


def test_without_a_file_the_parameters_have_their_defaults(launch, tmp_path):
    defaults = yaml.safe_load((ROOT / 'config' / 'player.yaml').read_text('utf-8'))
    values = values_of(launch(source='/some/where'), tmp_path)
    expected = defaults['kitti_player']['ros__parameters']
    assert values == {**expected, 'source': '/some/where'}
