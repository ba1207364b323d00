# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every place that states a default states the declared one.

Help texts, config/*.yaml, the ROS parameters and the arguments of launch/.
"""

import ast
from pathlib import Path

import pytest
import yaml

from kitti_ros2.cli import app
from kitti_ros2.cli.app import get_command
from kitti_ros2.cli.command import load_config
from kitti_ros2.options.datasets import CROP, SPLIT, make_crop_options, make_split_options
from kitti_ros2.options.declare import options_of
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.table import (
    PLAY,
    PLAY_OPTIONS,
    TO_BAG,
    TO_BAG_OPTIONS,
    TO_KITTI,
    VIEW,
    Settings,
    make_import_options,
    make_play_settings,
    make_settings,
    make_view_settings,
)

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = {
    'to-bag': (make_settings, TO_BAG),
    'to-kitti': (make_import_options, TO_KITTI),
    'view': (make_view_settings, VIEW),
    'crop': (make_crop_options, CROP),
    'split': (lambda values: make_split_options(values)[0], SPLIT),
    'play': (make_play_settings, PLAY),
}
DECLARED = [(command, each) for command, (_, table) in COMMANDS.items() for each in table]


def name_of(case):
    return case if isinstance(case, str) else case.name


def settled(settings):
    """Settings in a form that compares: a bag's options are made when the storage is known."""
    return {
        name: value('mcap') if name == 'bag' else value for name, value in vars(settings).items()
    }


@pytest.mark.parametrize(('command', 'option'), DECLARED, ids=name_of)
def test_a_default_that_is_given_changes_nothing(command, option):
    make, _ = COMMANDS[command]
    default = option.plain(option.default)
    if default is not None:
        given = option.default_text if option.unset and default != () else default
        given = given if option.name != 'scan_stamp' else 'forward'
        assert settled(make({option.name: given})) == settled(make({}))


@pytest.mark.parametrize(('command', 'option'), DECLARED, ids=name_of)
def test_help_states_the_default(command, option):
    parameters = get_command([command]).commands[command].params
    spelling = '--times' if option.name == 'loop' else option.flag
    found = [each for each in parameters if spelling in each.opts]
    assert len(found) == 1
    if option.default is not False:
        assert found[0].help.endswith(f' [default: {option.default_text}]')


def test_play_has_every_option_of_to_bag_but_those_of_the_bag():
    of_the_bag = {each.name for each in (*options_of(BagOptions), *options_of(Settings))}
    of_the_bag.add('clouds')  # the player publishes PointCloud2
    assert set(TO_BAG_OPTIONS) - set(PLAY_OPTIONS) == of_the_bag


def test_a_second_call_finds_the_same_options():
    first = get_command(['play']).commands['play'].params
    app._command_for.cache_clear()
    second = get_command(['play']).commands['play'].params
    assert [each.name for each in first] == [each.name for each in second]


def test_the_installed_config_of_to_bag_holds_every_option_at_its_default():
    values = load_config(ROOT / 'config' / 'to_bag.yaml', TO_BAG_OPTIONS)
    assert set(values) == set(TO_BAG_OPTIONS)
    assert settled(make_settings(values)) == settled(make_settings({}))


def test_ros_parameters_are_the_settings_at_their_defaults():
    parameters = pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
    defaults = {each.name: each.default for each in parameters.PARAMETERS}
    assert set(defaults) - parameters.COMMANDS == set(PLAY_OPTIONS)
    assert make_play_settings(parameters.given(defaults)) == make_play_settings({})


def test_player_yaml_holds_every_parameter_at_its_default():
    parameters = pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
    text = (ROOT / 'config' / 'player.yaml').read_text('utf-8')
    values = yaml.safe_load(text)['kitti_player']['ros__parameters']
    assert values == {each.name: each.default for each in parameters.PARAMETERS}
    lines = {line.split(':')[0].strip(): line for line in text.splitlines() if ':' in line}
    starred = {name for name in values if '# *' in lines[name]}
    assert starred == {each.name for each in parameters.PARAMETERS if each.live}


def test_arguments_of_play_bag_have_the_defaults():
    """Its player is that of ros2 bag, and its rate and clock those of ours."""
    tree = ast.parse((ROOT / 'launch' / 'play_bag.launch.py').read_text('utf-8'))
    defaults = {
        node.args[0].value: {each.arg: each.value.value for each in node.keywords}.get(
            'default_value'
        )
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'DeclareLaunchArgument'
    }
    playback = make_play_settings({}).playback
    assert defaults == {
        'bag': None,
        'rate': str(playback.rate),
        'clock': str(playback.clock_hz),
    }


def test_arguments_of_player_are_parameters_of_the_same_type():
    parameters = pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
    tree = ast.parse((ROOT / 'launch' / 'player.launch.py').read_text('utf-8'))
    table = next(
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == 'ARGUMENTS'
    )
    kinds = {row.elts[0].value: row.elts[2].id for row in table.elts}
    declared = {each.name: type(each.default).__name__ for each in parameters.PARAMETERS}
    assert kinds == {name: declared[name] for name in kinds}
