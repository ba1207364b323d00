# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The exit of a player is bounded, whatever the middleware waits for."""

import os
import signal
import subprocess
import sys

import pytest

from kitti_ros2.model.streams import Layout

pytest.importorskip('rclpy', reason='needs rclpy')

import live

from kitti_ros2.cli.exits import Ending
from kitti_ros2.player import middleware, run
from kitti_ros2.player.middleware import EXIT_S, Closing
from kitti_ros2.player.session import LAST_WAIT_S

from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

# A player whose node is as one of Cyclone DDS while a subscriber acknowledges nothing.
STUCK = """
import sys, threading
from kitti_ros2.cli import main
from kitti_ros2.player import node, outlets

for_ever = threading.Event()
place = sys.argv.pop(1)
if place == 'publish':
    outlets.Outlets.publish = lambda *_: (print('stuck', flush=True), for_ever.wait())
if place == 'delete':
    outlets.Outlets.close = lambda *_: for_ever.wait()
if place == 'destroy':
    node.KittiPlayer.destroy_node = lambda *_: for_ever.wait()
sys.argv[0] = 'kitti-ros2'
sys.exit(main())
"""


class Threads:
    """Stands for threading: a thread that runs at once, or is stuck for ever."""

    def __init__(self, *, stuck):
        self.stuck = stuck
        self.waited = []

    def Thread(self, target, **_):  # noqa: N802 - its name there
        self.target = target
        return self

    def start(self):
        if not self.stuck:
            self.target()

    def join(self, seconds):
        self.waited.append(seconds)

    def is_alive(self):
        return self.stuck


@pytest.fixture
def left(monkeypatch):
    """The exit codes of processes that would have been left at once."""
    codes = []
    monkeypatch.setattr(os, '_exit', codes.append)
    return codes


def test_what_is_closed_in_time_leaves_an_ordinary_exit(monkeypatch, left):
    threads = Threads(stuck=False)
    monkeypatch.setattr(middleware, 'threading', threads)
    ending, closed = Ending(), []
    with Closing(ending) as stack:
        stack.callback(closed.append, 'first')
        stack.callback(closed.append, 'last')
    ending.leave(0)
    assert (closed, left) == (['last', 'first'], [])


@pytest.mark.parametrize('code', [0, 1, 2])
def test_what_is_stuck_is_left_after_less_than_two_seconds(monkeypatch, left, code):
    threads = Threads(stuck=True)
    monkeypatch.setattr(middleware, 'threading', threads)
    ending = Ending()
    with Closing(ending) as stack:
        stack.callback(print)
    ending.leave(code)
    assert threads.waited == [EXIT_S]
    assert left == [code]


def test_the_exit_takes_at_most_two_seconds_in_all():
    assert EXIT_S < 2
    assert EXIT_S > LAST_WAIT_S


@pytest.mark.parametrize(('late', 'seconds'), [((), EXIT_S), (('/scan',), EXIT_S - LAST_WAIT_S)])
def test_the_wait_for_the_last_messages_is_part_of_the_exit(monkeypatch, recordings, late, seconds):
    given = []
    close = Closing.__exit__

    def close_and_note(self, *error):
        given.append(self.seconds)
        return close(self, *error)

    monkeypatch.setattr(Closing, '__exit__', close_and_note)
    monkeypatch.setattr('kitti_ros2.player.outlets.FlowControl.finish', lambda *_: late)
    values = {'source': str(recordings[Layout.RAW]), 'rate': 100.0}
    assert run.run_player(values, [], Ending(), keyboard=False) == 0
    assert given == [pytest.approx(seconds)]


def test_an_error_of_a_callback_is_not_lost():
    def fail():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), Closing(Ending()) as stack:
        stack.callback(fail)


def test_an_error_of_a_callback_does_not_hide_ctrl_c():
    def fail():
        raise ZeroDivisionError

    def interrupted():
        with Closing(Ending()) as stack:
            stack.callback(fail)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()


def test_threads_that_are_stuck_do_not_hold_the_process(tmp_path):
    """Not even one that is no daemon, which an exit of Python waits for."""
    program = (
        'import threading; from kitti_ros2.cli.exits import Ending;'
        'threading.Thread(target=threading.Event().wait).start();'
        'ending = Ending(); ending.abandon(); print("said"); ending.leave(3)'
    )
    done = subprocess.run(
        [sys.executable, '-c', program], env=live.environment(), cwd=tmp_path,
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (3, 'said\n')


@pytest.mark.parametrize('place', ['publish', 'delete', 'destroy'])
def test_a_stuck_player_ends_by_a_signal(recordings, place):
    """Nothing of it ever returns: without a bound it would run until the timeout."""
    words = [sys.executable, '-c', STUCK, place, 'play', str(recordings[Layout.RAW]), '--loop']
    process = subprocess.Popen(
        words, env=live.environment(), text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        stream = process.stdout if place == 'publish' else process.stderr
        assert stream.readline()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 0
    assert 'Traceback' not in said
