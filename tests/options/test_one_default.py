# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Every place that states a default states the one of the options objects.

Help texts, README's tables, config/*.yaml, the ROS parameters and the arguments of launch/.
"""

import ast
import re
from pathlib import Path

import pytest
import typer
import yaml

from kitti_ros2.cli.app import app
from kitti_ros2.cli.config_file import load_config
from kitti_ros2.options.table import (
    PLAY_OPTIONS,
    TO_BAG_OPTIONS,
    make_import_options,
    make_play_settings,
    make_settings,
    make_view_settings,
)

ROOT = Path(__file__).resolve().parents[2]
MAKERS = {
    'to-bag': make_settings,
    'to-kitti': make_import_options,
    'view': make_view_settings,
    'play': make_play_settings,
}
NAMES = {
    'times': 'loop',
    'split': 'train_fraction',
    'qos_profile_overrides_path': 'qos_overrides_path',
}
"""Options of the command line that have another name elsewhere."""
IN_WORDS = {
    ('to-bag', 'layout'): 'guess',
    ('to-bag', 'storage'): "by OUT's ending, or mcap",
    ('to-bag', 'compression_level'): "the compressor's own",
    ('to-bag', 'scan_stamp'): 'start with --ring-time, else forward',
    ('to-kitti', 'layout'): "a to-bag bag's own",
    ('view', 'layout'): 'guess',
    ('view', 'frame'): 'the first',
    ('view', 'frames'): 'all',
    ('view', 'camera'): '2, or the first',
    ('view', 'fps'): "the data's",
    ('play', 'layout'): 'guess',
    ('play', 'wait_for'): '1 with --lossless, else 0',
}
"""Defaults that depend on something, and so are no value."""
FLAGS = {'on': True, 'off': False}


def stated_in_help():
    """(command, option, text) of every help text that states a default."""
    for command, parsed in typer.main.get_command(app).commands.items():
        for parameter in parsed.params if command in MAKERS else ():
            stated = re.search(r'\[default: (.*)\]$', getattr(parameter, 'help', None) or '')
            if stated and parameter.opts[0].startswith('--'):
                name = parameter.opts[0].removeprefix('--').replace('-', '_')
                yield command, NAMES.get(name, name), stated[1].strip("'")


def stated_in_readme(command, heading):
    """(command, option, text) of a table of README.md, of rows that state one default."""
    text = (ROOT / 'README.md').read_text('utf-8').split(heading)[1].split('\n#')[0]
    for row in re.findall(r'^\| (`--.*)\|$', text, re.MULTILINE):
        options, _, default = (cell.strip() for cell in row.split(' | '))
        for name in re.findall(r'--([a-z-]+)', options):
            plain = name.replace('-', '_')
            yield command, NAMES.get(plain, plain), default


def settled(settings):
    """Settings in a form that compares: a bag's options are made when the storage is known."""
    return {
        name: value('mcap') if name == 'bag' else value for name, value in vars(settings).items()
    }


@pytest.mark.parametrize(('command', 'name', 'text'), [*stated_in_help()])
def test_help_states_the_default(command, name, text):
    if (command, name) in IN_WORDS:
        assert text == IN_WORDS[command, name]
        return
    make = MAKERS[command]
    made = make({name: text == 'tf' if name == 'tf' else text_or_number(text)})
    assert settled(made) == settled(make({}))


def text_or_number(text):
    """As typer hands it over: 0.1036 as a number, turbo as a word."""
    try:
        return float(text) if '.' in text else int(text)
    except ValueError:
        return text


README_IN_WORDS = {
    'layout': 'guessed',
    'sequence': 'the only one',
    'storage': "by OUT's ending, else mcap",
    'compression_level': 'its own',
    'split_size': 'never',
    'split_duration': 'never',
    'topics': 'all',
    'streams': 'all',
    'start': 'all of it',
    'end': 'all of it',
    'scan_stamp': 'start with `--ring-time`, else forward',
    'base_to_imu': '-0.05,0.32,0.93',
    'epoch': 'fixed, not 0',
    'loop': 'once',
    'start_paused': '',
    'delay': '',
    'wait_for': '0; 1 with `--lossless`',
    'lossless': 'by time',
    'qos_overrides_path': 'reliable, 10',
}


@pytest.mark.parametrize(
    ('command', 'name', 'text'),
    [
        *stated_in_readme('to-bag', '### Options of `to-bag`'),
        *stated_in_readme('play', '## Play it live'),
    ],
)
def test_readme_states_the_default(command, name, text):
    if name in README_IN_WORDS or name in {'config', 'quiet'}:
        assert text == README_IN_WORDS.get(name, text)
        return
    make = MAKERS[command]
    made = make({name: FLAGS.get(text, text_or_number(text))})
    assert settled(made) == settled(make({}))


def test_the_installed_config_of_to_bag_holds_every_option_at_its_default():
    values = load_config(ROOT / 'config' / 'to_bag.yaml', TO_BAG_OPTIONS)
    assert set(values) == set(TO_BAG_OPTIONS)
    assert settled(make_settings(values)) == settled(make_settings({}))


def test_ros_parameters_are_the_settings_at_their_defaults():
    parameters = pytest.importorskip('kitti_ros2.node.parameters', exc_type=ImportError)
    defaults = {each.name: each.default for each in parameters.PARAMETERS}
    assert set(defaults) - parameters.COMMANDS == set(PLAY_OPTIONS)
    assert make_play_settings(parameters.given(defaults)) == make_play_settings({})


def test_player_yaml_holds_every_parameter_at_its_default():
    parameters = pytest.importorskip('kitti_ros2.node.parameters', exc_type=ImportError)
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
    parameters = pytest.importorskip('kitti_ros2.node.parameters', exc_type=ImportError)
    tree = ast.parse((ROOT / 'launch' / 'player.launch.py').read_text('utf-8'))
    table = next(
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and node.targets[0].id == 'ARGUMENTS'
    )
    kinds = {row.elts[0].value: row.elts[2].id for row in table.elts}
    declared = {each.name: type(each.default).__name__ for each in parameters.PARAMETERS}
    assert kinds == {name: declared[name] for name in kinds}
