# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C while a command starts: no traceback, whenever it comes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kitti_ros2.cli.exits import EXIT_INTERRUPTED

from waiting import PATIENCE_S  # isort: skip

ROOT = Path(__file__).parents[2]
SAID = 'kitti-ros2: interrupted; no incomplete output is left behind\n'
PROGRAM = """
import os, signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)
import typing  # what pip's script and Python itself have imported
moment, left = int(sys.argv[1]), [int(sys.argv[1])]
sys.argv = ['kitti-ros2', *sys.argv[2:]]

def count(event, args):
    if event == 'import' and '_leave' in str(signal.getsignal(signal.SIGINT)) or left[0] < moment:
        if event == 'import':
            left[0] -= 1
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGINT)

sys.addaudithook(count)
from kitti_ros2.__main__ import main
code = main()
if left[0] > 0:
    print(moment - left[0])
sys.exit(code)
"""
"""Interrupts itself at the n-th import after the first line of the program's own module.

A start that is not interrupted prints how many imports it had.
"""


def interrupted(moment, *words):
    """Exit code, output and errors of a command that is interrupted at its n-th import."""
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, str(moment), *words],
        env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize('command', ['info', 'to-bag'])
def test_ctrl_c_while_a_command_starts_is_one_line(command, tmp_path):
    words = [command, str(tmp_path / 'nothing')]
    _, output, _ = interrupted(10**6, *words)
    imports = int(output)
    assert imports > 50
    for moment in {1, 2, 4, 8, 16, *(imports * part // 6 for part in range(1, 6))}:
        assert interrupted(moment, *words) == (EXIT_INTERRUPTED, '', SAID), moment


@pytest.mark.one_in(3)
@pytest.mark.parametrize('moment', [1, 2, 4, 8, 16, 32, 64])
def test_ctrl_c_while_a_player_starts_is_no_error(moment, tmp_path):
    """After the first imports the player handles it itself: it then sees what it was given."""
    code, said, complained = interrupted(moment, 'play', str(tmp_path / 'nothing'))
    assert said == ''
    assert (code, complained) == (0, '') or (code == 2 and len(complained.splitlines()) == 1)


def test_an_ignored_ctrl_c_stays_ignored():
    """Background jobs of a shell ignore it, and go on."""
    program = (
        'import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN);'
        ' sys.argv = ["kitti-ros2", "--version"]; from kitti_ros2.__main__ import main;'
        ' signal.raise_signal(signal.SIGINT); code = main();'
        ' signal.raise_signal(signal.SIGINT); sys.exit(code)'
    )
    done = subprocess.run(
        [sys.executable, '-c', program],
        env={**os.environ, 'PYTHONPATH': str(ROOT)}, capture_output=True, text=True,
        timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith('kitti_ros2 ')
