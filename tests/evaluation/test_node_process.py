# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The process of a node: its words, its output, its end."""

import re
import shlex
import signal
import sys

import pytest

from kitti_ros2.evaluation import live
from kitti_ros2.evaluation.live import NodeProcess
from kitti_ros2.model.errors import UsageError

from waiting import is_running, wait_until  # isort: skip

SHORT_STOPS = ((signal.SIGINT, 0.1), (signal.SIGTERM, 0.1), (signal.SIGKILL, 20.0))


def python(code):
    return shlex.join([sys.executable, '-c', code])


@pytest.mark.parametrize(
    ('command', 'complaint'),
    [
        ('"python', "--node '\"python' cannot be split into words: No closing quotation"),
        (' ', '--node is empty'),
        ('no-such-program --x', '--node cannot be started: no-such-program: No such file'),
        ('/', '--node cannot be started: /: Permission denied'),
        ('cd x && ros2 run a b', 'no shell interprets it: for what a shell does, give "bash -c'),
        ('SPEED=1 no-such-program', 'SPEED=1: No such file or directory; no shell interprets it'),
    ],
)
def test_a_command_that_cannot_run_is_named(command, complaint):
    with pytest.raises(UsageError, match=re.escape(complaint)):
        NodeProcess(command, lambda _: None)


def test_its_output_is_shown_and_its_end_described():
    lines = []
    with NodeProcess(
        python('import sys; print("a b"); print("bad \\x1b[1m\\n", file=sys.stderr); sys.exit(3)'),
        lines.append,
    ) as node:
        wait_until(node.ended)
        assert node.ended() == 'exit code 3; its last line: bad \\x1b[1m'
    assert lines == [b'a b\n', b'bad \x1b[1m\n', b'\n']
    assert not node.killed


def test_a_crash_is_named_by_its_signal():
    with NodeProcess(python('import os; os.kill(os.getpid(), 11)'), lambda _: None) as node:
        wait_until(node.ended)
        assert node.ended() == 'killed by SIGSEGV'


def test_it_runs_on_when_nobody_shows_its_output():
    def fail(_):
        raise BrokenPipeError

    with NodeProcess(python('print("x" * 200_000); print("done")'), fail) as node:
        wait_until(node.ended)
        assert node.ended() == 'exit code 0; its last line: done'


def test_words_are_those_of_a_shell():
    lines = []
    command = f'{python("import sys; print(sys.argv[1:])")} "a b" c\\ d $HOME'
    with NodeProcess(command, lines.append) as node:
        wait_until(node.ended)
    assert lines == [b"['a b', 'c d', '$HOME']\n"]


def test_it_is_stopped_by_ctrl_c_with_all_its_processes():
    code = (
        'import os, signal\n'
        'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
        'child = os.fork()\n'
        'try:\n'
        '    os.write(1, b"%d\\n" % os.getpid())\n'
        '    signal.pause()\n'
        'except KeyboardInterrupt:\n'
        '    os.write(1, b"clean\\n")\n'
    )
    lines = []
    with NodeProcess(python(code), lines.append) as node:
        wait_until(lambda: len(lines) == 2)
        pids = [int(line) for line in lines]
        assert node.ended() == ''
        assert all(map(is_running, pids))
    assert not is_running(node._process.pid)
    assert lines[2:] == [b'clean\n'] * 2
    assert not node.killed


def test_one_that_ignores_signals_is_killed(monkeypatch):
    monkeypatch.setattr(live, '_STOPS', SHORT_STOPS)
    code = (
        'import signal\n'
        'for each in (signal.SIGINT, signal.SIGTERM):\n'
        '    signal.signal(each, signal.SIG_IGN)\n'
        'print("ready", flush=True)\n'
        'while True:\n'
        '    signal.pause()\n'
    )
    lines = []
    with NodeProcess(python(code), lines.append) as node:
        wait_until(lambda: lines)
    assert node.killed
    assert not is_running(node._process.pid)


def test_it_is_stopped_when_its_user_fails():
    lines = []
    code = 'import os, signal; print(os.getpid(), flush=True); signal.pause()'

    def fail():
        with NodeProcess(python(code), lines.append):
            wait_until(lambda: lines)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not is_running(int(lines[0]))
