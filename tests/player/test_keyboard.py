# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Keys in a terminal of the test's own."""

import fcntl
import io
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import textwrap
import threading
from pathlib import Path

import pytest

from kitti_ros2.player import terminal as player_terminal
from kitti_ros2.player.terminal import Key, Keyboard

from waiting import PATIENCE_S, wait_until  # isort: skip


@pytest.fixture
def terminal(monkeypatch):
    """Both ends of a terminal; it is nobody's, so it counts as in the foreground."""
    master, slave = pty.openpty()
    monkeypatch.setattr(player_terminal, 'in_foreground', lambda _: True)
    stream = os.fdopen(slave, 'r')
    yield master, stream
    os.close(master)
    stream.close()


def type_in(terminal, keys):
    """Write to a terminal, and wait until everything is read."""
    master, stream = terminal
    os.write(master, keys)
    wait_until(
        lambda: not any(fcntl.ioctl(stream.fileno(), termios.FIONREAD, bytes(struct.calcsize('i'))))
    )


def pressed(terminal, keys, count, on_error=None):
    """What is pressed on a terminal when bytes come in."""
    seen = []
    actions = {key: lambda key=key: seen.append(key) for key in Key}
    with Keyboard(actions, on_error or seen.append, terminal[1]):
        for part in keys:
            type_in(terminal, part)
        wait_until(lambda: len(seen) >= count)
    return seen


@pytest.mark.parametrize(
    ('keys', 'expected'),
    [
        ([b' '], [Key.SPACE]),
        ([b'\x1b[C'], [Key.RIGHT]),
        ([b'\x1bOC'], [Key.RIGHT]),
        ([b'\x1b', b'[', b'D'], [Key.LEFT]),
        ([b'\x1b[A\x1b[B  q'], [Key.UP, Key.DOWN, Key.SPACE, Key.SPACE, Key.QUIT]),
        ([b'x', b'y', b'q'], [Key.QUIT]),
        ([b'\x1b[Z', b' '], [Key.SPACE]),
        ([b'\x1b[1;5C\x1b[3~\x1bOPq'], [Key.QUIT]),
        ([b'\x1b[?1 q '], [Key.SPACE]),
        ([b'\x1b\x1b[C'], [Key.RIGHT]),
    ],
)
def test_keys(terminal, monkeypatch, keys, expected):
    monkeypatch.setattr(player_terminal, '_REST_OF_ESCAPE_S', 60)
    assert pressed(terminal, keys, len(expected)) == expected


def test_a_lone_escape_is_nothing(terminal, monkeypatch):
    seen, rests = [], []
    read_soon = Keyboard._read_soon

    def read_and_note(self):
        rests.append(read_soon(self))
        return rests[-1]

    monkeypatch.setattr(Keyboard, '_read_soon', read_and_note)
    with Keyboard({Key.SPACE: lambda: seen.append(1)}, seen.append, terminal[1]):
        type_in(terminal, b'\x1b')
        wait_until(lambda: rests == [b''])
        type_in(terminal, b' ')
        wait_until(lambda: seen)
    assert seen == [1]


def test_the_terminal_is_as_before(terminal):
    _, stream = terminal
    before = termios.tcgetattr(stream.fileno())

    def fail_inside():
        with Keyboard({}, lambda _: None, stream):
            assert not termios.tcgetattr(stream.fileno())[3] & termios.ICANON
            assert termios.tcgetattr(stream.fileno())[3] & termios.ISIG
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail_inside()
    assert termios.tcgetattr(stream.fileno()) == before


def test_what_was_begun_is_undone_when_no_thread_can_start(terminal, monkeypatch):
    _, stream = terminal
    before = termios.tcgetattr(stream.fileno())

    def refuse(_):
        raise RuntimeError

    monkeypatch.setattr(threading.Thread, 'start', refuse)
    descriptors = len(list(Path('/dev/fd').iterdir()))
    with pytest.raises(RuntimeError), Keyboard({}, lambda _: None, stream):
        pass
    assert termios.tcgetattr(stream.fileno()) == before
    assert len(list(Path('/dev/fd').iterdir())) == descriptors


@pytest.mark.parametrize('keys', [b'', b'\x1b', b'\x1b['])
def test_closing_waits_for_no_key(terminal, monkeypatch, keys):
    monkeypatch.setattr(player_terminal, '_POLL_S', 3600)
    monkeypatch.setattr(player_terminal, '_REST_OF_ESCAPE_S', 3600)
    monkeypatch.setattr(player_terminal, '_DEADLY', ())  # only the main thread may handle signals
    entered = Keyboard({}, lambda _: None, terminal[1]).__enter__()
    type_in(terminal, keys)
    closing = threading.Thread(target=entered.__exit__, args=(None, None, None), daemon=True)
    closing.start()
    closing.join(PATIENCE_S)
    assert not closing.is_alive()
    assert not entered._thread.is_alive()


def test_the_thread_ends_with_its_terminal(monkeypatch):
    master, slave = pty.openpty()
    monkeypatch.setattr(player_terminal, 'in_foreground', lambda _: True)
    with os.fdopen(slave, 'r') as stream, Keyboard({}, lambda _: None, stream) as entered:
        os.close(master)
        wait_until(lambda: not entered._thread.is_alive())


def test_the_mode_comes_back_after_a_shell_changed_it(terminal, monkeypatch):
    _, stream = terminal
    monkeypatch.setattr(player_terminal, '_POLL_S', 0.02)
    before = termios.tcgetattr(stream.fileno())
    with Keyboard({}, lambda _: None, stream):
        termios.tcsetattr(stream.fileno(), termios.TCSANOW, before)
        wait_until(lambda: not termios.tcgetattr(stream.fileno())[3] & termios.ICANON)


def test_an_action_that_fails_is_told_and_the_next_key_works(terminal):
    master, stream = terminal
    errors, seen = [], []

    def fail():
        raise ValueError('no')

    with Keyboard({Key.SPACE: fail, Key.QUIT: lambda: seen.append(1)}, errors.append, stream):
        os.write(master, b' q')
        wait_until(lambda: seen)
    assert [str(error) for error in errors] == ['no']


def test_what_is_no_terminal_is_left_alone(tmp_path):
    for stream in (io.StringIO(' '), open(tmp_path / 'x', 'w+')):  # noqa: SIM115, PTH123
        with Keyboard({}, lambda _: None, stream) as entered:
            assert entered._thread is None


def test_in_the_background_nothing_is_read():
    master, slave = pty.openpty()
    with os.fdopen(slave, 'r') as stream, Keyboard({}, lambda _: None, stream) as entered:
        assert entered._thread is None
    os.close(master)


def test_no_standard_input_is_no_terminal(monkeypatch):
    monkeypatch.setattr(sys, 'stdin', None)
    with Keyboard({}, lambda _: None) as entered:
        assert entered._thread is None


# A shell, the terminal's own session leader, and its job, which ends on q or when told to.
SHELL = """
    import fcntl, os, select, signal, sys, termios, threading
    from kitti_ros2.player import terminal as keyboard

    keyboard._POLL_S = 0.02
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    ours = termios.tcgetattr(0)
    from_job, to_shell = os.pipe()
    go, to_job = os.pipe()
    checks, to_checks = os.pipe()
    in_foreground = keyboard.in_foreground
    keyboard.in_foreground = lambda _: os.write(to_checks, b'.') and in_foreground(0)
    job = os.fork()
    if job == 0:
        signal.signal(signal.SIGTTOU, signal.SIG_DFL)
        os.setpgid(0, 0)
        os.read(go, 1)
        end = threading.Event()
        actions = {
            keyboard.Key.SPACE: lambda: os.write(to_shell, b's'), keyboard.Key.QUIT: end.set
        }
        with keyboard.Keyboard(actions, print):
            os.write(to_shell, b'r')
            threading.Thread(target=lambda: os.read(go, 1) and end.set(), daemon=True).start()
            end.wait()
        os._exit(7)

    def say(word):
        print(word, file=sys.stderr, flush=True)

    def wait_for_checks(count):
        os.read(checks, 65536)  # those so far
        for _ in range(count):
            os.read(checks, 1)

    def cooked():
        return bool(termios.tcgetattr(0)[3] & termios.ICANON)

    os.setpgid(job, job)
    os.tcsetpgrp(0, job)
    os.write(to_job, b'.')
    say(os.read(from_job, 1).decode() + str(cooked()))
    say(os.read(from_job, 1).decode())
    # Ctrl-Z and bg
    os.tcsetpgrp(0, os.getpgrp())
    termios.tcsetattr(0, termios.TCSANOW, ours)
    say('background')
    select.select([0], [], [])
    wait_for_checks(4)
    line = os.read(0, 100)
    say(f'{line!r} {cooked()} {os.waitpid(job, os.WNOHANG | os.WUNTRACED)}')
    if sys.argv[1] == 'fg':
        os.tcsetpgrp(0, job)
        while cooked():
            wait_for_checks(1)
        say('foreground')
    else:
        os.write(to_job, b'.')
    status = os.waitpid(job, os.WUNTRACED)[1]
    say(f'{os.WIFSTOPPED(status)} {os.waitstatus_to_exitcode(status)} {cooked()}')
"""


@pytest.mark.parametrize('way', ['fg', 'stay'])
def test_a_job_in_the_background_leaves_the_terminal_to_the_shell(way):
    master, slave = pty.openpty()
    shell = subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(SHELL), way],
        stdin=slave,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    os.close(slave)
    watchdog = threading.Timer(PATIENCE_S, shell.kill)
    watchdog.start()
    with shell:
        assert shell.stderr.readline() == 'rFalse\n'
        os.write(master, b' ')
        assert shell.stderr.readline() == 's\n'
        assert shell.stderr.readline() == 'background\n'
        os.write(master, b' q\n')
        assert shell.stderr.readline() == "b' q\\n' True (0, 0)\n"
        if way == 'fg':
            assert shell.stderr.readline() == 'foreground\n'
            os.write(master, b'q')
        assert shell.stderr.readline() == 'False 7 True\n'
    watchdog.cancel()
    os.close(master)


# A foreground process of its terminal that a signal ends.
KILLED = """
    import fcntl, resource, signal, termios
    from kitti_ros2.player.terminal import Keyboard

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # Of tests that run in the background the shell lets SIGQUIT be ignored.
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    with Keyboard({}, print):
        assert not termios.tcgetattr(0)[3] & termios.ICANON
        print('ready', flush=True)
        while True:
            signal.pause()
"""


@pytest.mark.parametrize('number', player_terminal._DEADLY)
def test_a_signal_that_ends_the_process_leaves_the_mode_of_before(number):
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    process = subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(KILLED)],
        stdin=slave,
        stdout=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    with process:
        assert process.stdout.readline() == 'ready\n'
        if number == signal.SIGQUIT:
            os.write(master, b'\x1c')
        else:
            process.send_signal(number)
        assert process.wait(timeout=PATIENCE_S) == -number
    assert termios.tcgetattr(slave) == before
    os.close(slave)
    os.close(master)


def test_signals_that_are_handled_are_left_alone(terminal):
    def handle(*_):
        pass

    before = signal.signal(signal.SIGUSR1, handle)
    quitting = signal.signal(signal.SIGQUIT, signal.SIG_DFL)  # ignored in the background
    try:
        with Keyboard({}, lambda _: None, terminal[1]):
            assert signal.getsignal(signal.SIGUSR1) is handle
            assert signal.getsignal(signal.SIGQUIT) is not signal.SIG_DFL
        assert signal.getsignal(signal.SIGUSR1) is handle
        assert signal.getsignal(signal.SIGQUIT) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGUSR1, before)
        signal.signal(signal.SIGQUIT, quitting)
