# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Completion in real shells, after --install-completion; and its answers to the shell."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest

from kitti_ros2.cli import main
from kitti_ros2.cli.completion import VARIABLE
from kitti_ros2.model.streams import Layout

from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

SHELLS = {
    'bash': ['--norc', '-i'],
    'zsh': ['-i'],
    'fish': ['-i'],
}
# Runs the command for completions and prints its arguments otherwise: RAN<to-bag ...>.
COMMAND = """#!/bin/sh
if [ -n "${VARIABLE}" ] || [ "$1" = --install-completion ]; then
  exec {python} -c 'import sys; from kitti_ros2.cli import main; sys.exit(main())' "$@"
fi
printf 'RAN<%s>\\n' "$*"
"""
TYPED = [
    ('to-b\t', 'to-bag'),
    ('to-bag --exclude-\t', 'to-bag --exclude-topics'),
    ('to-bag --layout od\t', 'to-bag --layout odometry'),
    ('to-bag --preset kitti\t', 'to-bag --preset kitti2bag'),
    ('view --mode bo\t', 'view --mode boxes'),
    ('to-kitti drive.mcap --prev\t', 'to-kitti drive.mcap --preview'),
    ('demo --layout tr\t', 'demo --layout tracking'),
    ('to-bag raw out --topics /kitti/ve\t', 'to-bag raw out --topics /kitti/velo/points'),
    ('to-bag raw --sequence 2011\t', 'to-bag raw --sequence 2011_09_26_drive_0001_sync'),
    ('to-bag raw out --streams sc\t', 'to-bag raw out --streams scan'),
    (
        'play drive.mcap --topics /tf /kitti/oxts/i\t',
        'play drive.mcap --topics /tf /kitti/oxts/imu',
    ),
    ('info dri\t', 'info drive.mcap'),
    ('play broken.mcap --topics qq\t', 'play broken.mcap --topics qq'),
    ('play absent --topics qq\t', 'play absent --topics qq'),
    ('view drive.mcap dri\t', 'view drive.mcap drive.mcap'),
]
ONE_OF_EACH_KIND = [TYPED[at] for at in (0, 1, 2, 7, 10, 11, 12, 14)]
"""A command, an option, a choice, a topic, a topic of several, a file, none, and OUT."""


@pytest.fixture(scope='module')
def home(recordings, tmp_path_factory):
    """A home folder with the command, a data set, a bag and a broken one."""
    folder = tmp_path_factory.mktemp('home')
    command = folder / 'bin' / 'kitti-ros2'
    command.parent.mkdir()
    command.write_text(COMMAND.format(VARIABLE=VARIABLE, python=sys.executable))
    command.chmod(0o755)
    (folder / 'raw').symlink_to(recordings[Layout.RAW].parent.parent)
    words = ['to-bag', str(recordings[Layout.RAW]), str(folder / 'drive.mcap'), '-q']
    assert main([*words, '--exclude-topics', '*image*']) == 0
    (folder / 'broken.mcap').write_bytes(b'\x89MCAP0\r\n' + bytes(100))
    return folder


def environment(home):
    path = f'{home / "bin"}{os.pathsep}{os.environ["PATH"]}'
    kept = {name: os.environ[name] for name in ('PYTHONPATH', 'LANG') if name in os.environ}
    return {**kept, 'HOME': str(home), 'PATH': path, 'TERM': 'dumb', 'PS1': '$ '}


@pytest.mark.parametrize(
    ('name', 'lines'),
    [('bash', TYPED), ('zsh', ONE_OF_EACH_KIND), ('fish', ONE_OF_EACH_KIND)],
    ids=list(SHELLS),
)
def test_a_shell_completes_what_is_typed(home, name, lines):
    pexpect = pytest.importorskip('pexpect')
    shell = shutil.which(name)
    if shell is None:
        pytest.skip(f'{name} is not installed')
    start = [shell, *SHELLS[name]]
    settings = {
        'cwd': str(home),
        'env': environment(home),
        'encoding': 'utf-8',
        'timeout': PATIENCE_S,
    }
    with pexpect.spawn(start[0], start[1:], **settings) as session:
        session.sendline('kitti-ros2 --install-completion')
        session.expect(f'{name} completion installed')
        session.sendline('exit')
        session.expect(pexpect.EOF)
    if name == 'bash':
        start[1:] = ['--rcfile', str(home / '.bashrc'), '-i']
    with pexpect.spawn(start[0], start[1:], dimensions=(50, 200), **settings) as session:
        for typed, completed in lines:
            session.send(f'kitti-ros2 {typed}\r')
            session.expect(r'RAN<(.*?)>')
            assert session.match[1].strip() == completed
            assert 'kitti-ros2:' not in session.before
            assert 'Traceback' not in session.before
        session.sendline('exit')
        session.expect(pexpect.EOF)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('shell', list(SHELLS))
@pytest.mark.parametrize('words', ['play broken.mcap --topics ', 'no-command ', 'to-bag --x '])
def test_what_is_wrong_is_answered_without_a_word(home, shell, words):
    line = f'kitti-ros2 {words}'
    asked = {
        VARIABLE: f'complete_{shell}',
        'COMP_WORDS': line.strip().replace(' ', '\n'),
        'COMP_CWORD': str(len(line.split())),
        '_TYPER_COMPLETE_ARGS': line,
        '_TYPER_COMPLETE_FISH_ACTION': 'get-args',
    }
    if shell == 'bash':
        del asked['_TYPER_COMPLETE_ARGS']
    done = subprocess.run(
        ['kitti-ros2'],
        cwd=home,
        env={**environment(home), **asked},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.stderr
    if 'no-command' not in words:  # which may become one of the commands
        assert done.stdout.strip() in {'', '_files'}


def test_a_list_offers_every_topic_of_the_bag(home):
    line = 'kitti-ros2 play drive.mcap --exclude-topics /tf '
    asked = {VARIABLE: 'complete_zsh', '_TYPER_COMPLETE_ARGS': line}
    words = {'cwd': home, 'env': {**environment(home), **asked}, 'text': True}
    offered = subprocess.run(['kitti-ros2'], capture_output=True, check=True, **words).stdout
    assert '"/tf_static"' in offered
    assert '"/kitti/oxts/imu"' in offered
    assert 'image' not in offered
