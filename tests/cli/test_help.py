# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Help texts at 80 columns: whole lines, groups, choices, examples that parse."""

from __future__ import annotations

import os
import pty
import re
import shlex
import subprocess
import sys

import pytest

from kitti_ros2.cli import main
from kitti_ros2.cli.app import command_names, find_command, get_command
from kitti_ros2.options import datasets, evaluation, table
from kitti_ros2.pictures.panel import MODES

from terminals import read_to_the_end  # isort: skip

COMMANDS = {
    'to-bag': 'SRC OUT',
    'to-kitti': 'BAG... OUT',
    'status': 'OUT',
    'recover': 'BAG OUT',
    'info': 'SRC',
    'validate': 'PATH...',
    'view': 'SRC [OUT]',
    'report': 'SRC [OUT]',
    'crop': 'SRC OUT',
    'stats': 'PATH...',
    'split': 'SRC [OUT]',
    'stacks': '[STACK] [OUT]',
    'download': '[WHAT... ROOT]',
    'extract': 'ARCHIVE... ROOT',
    'demo': '[OUT]',
    'eval tracking': 'GT RESULTS [OUT]',
    'play': '[SRC]',
    'eval detection': 'GROUND_TRUTH RESULTS [OUT]',
    'eval odometry': 'GT RESULT [OUT]',
    'eval live': 'SRC [OUT]',
}
TABLES = {
    'to-bag': table.TO_BAG_ALL,
    'to-kitti': table.TO_KITTI_ALL,
    'view': table.VIEW,
    'crop': datasets.CROP,
    'download': datasets.DOWNLOAD,
    'extract': datasets.EXTRACT,
    'play': table.PLAY,
    'info': table.SOURCE,
    'validate': datasets.VALIDATE_ALL,
    'report': table.REPORT_ALL,
    'stats': datasets.STATS_ALL,
    'split': datasets.SPLIT,
    'eval detection': evaluation.DETECTION_ALL,
    'eval odometry': evaluation.ODOMETRY_ALL,
    'eval tracking': evaluation.TRACKING_ALL,
    'eval live': evaluation.LIVE,
}


@pytest.fixture(autouse=True)
def columns(monkeypatch):
    monkeypatch.setenv('COLUMNS', '80')


@pytest.fixture
def help_of(capsys):
    def shown(*words, flag='--help'):
        assert main([*words, flag]) == 0
        return capsys.readouterr().out

    return shown


@pytest.mark.parametrize('group', ['', 'eval'])
def test_every_command_is_listed_with_its_whole_first_line(group, help_of):
    text = help_of(*group.split())
    assert max(map(len, text.splitlines())) <= 80
    listed = dict(re.findall(r'^  ([a-z-]+)  +(\S.*)$', text.split('Commands:\n')[1], re.MULTILINE))
    within = [name.removeprefix(group).split() for name in COMMANDS if name.startswith(group)]
    assert set(listed) == {words[0] for words in within}
    for name, summary in listed.items():
        assert summary.endswith('.')
        assert not summary.endswith('...')
        assert help_of(*group.split(), name).split('\n\n')[1].strip() == summary


@pytest.mark.parametrize('command', COMMANDS)
def test_a_command_has_its_arguments_as_written_groups_and_two_examples(command, help_of):
    text = help_of(*command.split())
    assert max(map(len, text.splitlines())) <= 80
    assert text.startswith(f'Usage: kitti-ros2 {command} [OPTIONS] {COMMANDS[command]}\n')
    for name in re.findall(r'[A-Z_]+', COMMANDS[command]):
        assert re.search(rf'^  .*\b{name}', text.split('Arguments:\n')[1], re.MULTILINE)
    examples = text.split('Examples:\n')[1].splitlines()
    assert len(examples) == 2
    for example in examples:
        _, *words = shlex.split(example)
        name, found = find_command(words)
        assert name == command
        found.make_context(name, words[len(name.split()) :])


@pytest.mark.parametrize('command', TABLES)
def test_options_stand_in_their_groups_with_their_choices(command, help_of):
    text = help_of(*command.split(), flag='--help-all')
    sections = dict(re.findall(r'^(\S.*):\n((?:  .*\n)+)', text, re.MULTILINE))
    for option in TABLES[command]:
        assert option.group
        if option.name == 'out':
            assert '  OUT, -o OUT ' in sections['Arguments']
            continue
        if option.config_only:
            assert f'  {option.name} ' in sections['In the file of --config']
            continue
        spelling = re.escape(option.flag)
        listed = option.choices and not option.metavar
        words = re.escape(f' [{"|".join(option.choices)}]') if listed else ''
        assert re.search(rf'{spelling}\b{words}', sections[option.group]), option.name


@pytest.mark.parametrize('command', COMMANDS)
def test_help_shows_a_dozen_options_and_help_all_the_others(command, help_of):
    shown, all_shown = (
        set(re.findall(r'^  (?:-\w, )?(--[a-z-]+)', text, re.MULTILINE)) - {'--help'}
        for text in (help_of(*command.split()), help_of(*command.split(), flag='--help-all'))
    )
    _, found = find_command(command.split())
    flags = [each.opts for each in found.params if each.param_type_name == 'option']
    count = len(flags)
    if '[OUT]' in COMMANDS[command]:  # an option that is listed with the arguments
        count -= sum('--out' in each for each in flags)
    assert len(shown) <= 12
    assert shown <= all_shown
    left = f'These are {len(shown)} of {count} options; kitti-ros2 {command} --help-all shows all.'
    assert (
        (left in ' '.join(help_of(*command.split()).split()))
        == (shown < all_shown)
        == (len(shown) < count)
    )


def test_the_modes_of_pictures_are_the_choices():
    (mode,) = (each for each in table.VIEW if each.name == 'mode')
    assert mode.choices == tuple(MODES)


@pytest.mark.parametrize('name', command_names())
def test_the_list_shows_the_first_line_of_the_help_of_a_command(name):
    listed = get_command([])
    for word in name.split():
        listed = listed.commands[word]
    _, command = find_command(name.split())
    assert listed.help == command.help.splitlines()[0]


def test_a_terminal_shows_what_a_pipe_gets():
    words = [sys.executable, '-m', 'kitti_ros2', 'to-bag', '--help']
    piped = subprocess.run(words, capture_output=True, check=True).stdout
    master, slave = pty.openpty()
    with subprocess.Popen(words, stdout=slave, stdin=slave) as process:
        os.close(slave)
        shown = read_to_the_end(master)
        assert process.wait() == 0
    assert shown.replace(b'\r\n', b'\n') == piped
