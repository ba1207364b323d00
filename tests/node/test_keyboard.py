# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Keys in a terminal of the test's own."""

import io
import os
import pty
import termios
import time

import pytest

from kitti_ros2.node import keyboard
from kitti_ros2.node.keyboard import Key, Keyboard


@pytest.fixture
def terminal(monkeypatch):
    """Both ends of a terminal; it is nobody's, so it counts as in the foreground."""
    master, slave = pty.openpty()
    monkeypatch.setattr(keyboard, '_in_foreground', lambda _: True)
    stream = os.fdopen(slave, 'r')
    yield master, stream
    os.close(master)
    stream.close()


def wait_for(condition):
    end = time.monotonic() + 5
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def pressed(terminal, keys, count, on_error=None):
    """What is pressed on a terminal when bytes come in."""
    master, stream = terminal
    seen = []
    actions = {key: lambda key=key: seen.append(key) for key in Key}
    with Keyboard(actions, on_error or seen.append, stream):
        for part in keys:
            os.write(master, part)
            time.sleep(0.01)
        wait_for(lambda: len(seen) >= count)
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
    ],
)
def test_keys(terminal, keys, expected):
    assert pressed(terminal, keys, len(expected)) == expected


def test_a_lone_escape_is_nothing(terminal):
    master, stream = terminal
    seen = []
    with Keyboard({Key.SPACE: lambda: seen.append(1)}, seen.append, stream):
        os.write(master, b'\x1b')
        time.sleep(0.15)
        os.write(master, b' ')
        wait_for(lambda: seen)
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


def test_the_mode_comes_back_after_a_shell_changed_it(terminal, monkeypatch):
    _, stream = terminal
    monkeypatch.setattr(keyboard, '_LOOK_AGAIN_S', 0.02)
    before = termios.tcgetattr(stream.fileno())
    with Keyboard({}, lambda _: None, stream):
        termios.tcsetattr(stream.fileno(), termios.TCSANOW, before)
        wait_for(lambda: not termios.tcgetattr(stream.fileno())[3] & termios.ICANON)


def test_an_action_that_fails_is_told_and_the_next_key_works(terminal):
    master, stream = terminal
    errors, seen = [], []

    def fail():
        raise ValueError('no')

    with Keyboard({Key.SPACE: fail, Key.QUIT: lambda: seen.append(1)}, errors.append, stream):
        os.write(master, b' q')
        wait_for(lambda: seen)
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
