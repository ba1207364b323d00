# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A player and a listener as two processes over the real middleware."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

from kitti_ros2.bags.reader import open_messages

from waiting import PATIENCE_S  # isort: skip

HERE = Path(__file__).parent
GRACE_S = 10
MAIN = 'import sys; sys.argv[0] = "kitti-ros2"; from kitti_ros2.cli import main; sys.exit(main())'

WATCHED = f"""
from kitti_ros2.player.outlets import Outlets
from kitti_ros2.player import session
from kitti_ros2.player.playback import Playback

session.LAST_WAIT_S = {PATIENCE_S}
Playback.play_next.__defaults__ = ({PATIENCE_S},)
wanted, seen = Outlets.wanted, [0]

def count(self, now_ns):
    found = sum(each.get_subscription_count() for each in list(self._publishers.values()))
    if found != seen[-1]:
        seen.append(found)
        print(found, flush=True)
    return wanted(self, now_ns)

Outlets.wanted = count
{MAIN}
"""
"""The same, which prints how many subscriptions its topics have whenever that changes.

Its play_next waits longer for a frame than a user would, and its end for the last messages to
arrive: both take their time on a busy machine.
"""


PLAYER_PYTHON = os.environ.get('PLAYER_PYTHON', sys.executable)
"""The interpreter of the players, whose ROS 2 may be another than that of the tests."""


def environment(python=sys.executable):
    """Of our own processes: what they say stays on this machine, and among themselves."""
    changes = {'PYTHONPATH': str(HERE.parents[1]), 'PYTHONUNBUFFERED': '1'}
    inherited = dict(os.environ)
    if python != sys.executable:
        # The wheels of ROS 2 set these once, and so for the libraries of this interpreter.
        for name in ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'):
            inherited.pop(name, None)
    return inherited | changes


def play(src, *options, program=WATCHED, **more):
    """Start a player."""
    words = [PLAYER_PYTHON, '-c', program, 'play', *([str(src)] if src else [])]
    words += map(str, options)
    return subprocess.Popen(
        words, env=environment(PLAYER_PYTHON), text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more,
    )  # fmt: skip


class Listening:
    """The other process; topics by name with their types."""

    def __init__(self, topics):
        words = [sys.executable, str(HERE / 'listener.py')]
        self.topics = dict(topics)
        self.process = subprocess.Popen(
            words + [f'{topic}={msgtype}' for topic, msgtype in self.topics.items()],
            env=environment(), text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        assert self.process.stdout.readline() == 'ready\n'

    def tell(self, *words):
        """What it answers to a line."""
        self.process.stdin.write(' '.join(map(str, words)) + '\n')
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def wait_for_publishers(self, player, subscriptions=None):
        """Wait until it and a player have found each other, for every topic.

        Args:
            player: A watched player.
            subscriptions: How many its topics have then, if not one of each of the listener's.
        """
        for topic in self.topics:
            assert self.tell('publishers', topic), f'nobody publishes {topic}'
        expected = len(self.topics) if subscriptions is None else subscriptions
        found = 0
        while found < expected:
            line = player.stdout.readline()
            assert line, 'the player has ended'
            found = int(line)

    def last_state(self, name, value):
        """The values of the state in which one begins with a text."""
        values = self.tell('state', name, value)
        assert values[name].startswith(value), values
        return values

    def heard(self):
        """End it; by topic the stamp of each message, if its type has one, and its digest."""
        self.process.stdin.close()
        heard = json.loads(self.process.stdout.read().splitlines()[-1])
        assert self.process.wait(PATIENCE_S) == 0
        return heard


class Recording:
    """A process that subscribes as `ros2 bag record -a` does."""

    def __init__(self, *out):
        words = [sys.executable, str(HERE / 'recorder.py'), *map(str, out)]
        self.process = subprocess.Popen(
            words, env=environment(), text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def counts(self):
        """End it; by topic how many messages came."""
        said, _ = self.process.communicate(timeout=PATIENCE_S)
        return json.loads(said.splitlines()[-1])


def hear_all(topics, src, *options):
    """Play a source to its end without loss, and return what a listener heard of the topics."""
    player = play(src, '--start-paused', '--lossless', *options)
    listener = Listening(topics)
    try:
        listener.wait_for_publishers(player)
        assert listener.tell('call', 'resume')[0]
        _, said = player.communicate(timeout=PATIENCE_S)
        assert player.returncode == 0, said
        return listener.heard()
    finally:
        stop(player)
        stop(listener.process)


def stop(process):
    """End a process that a test is done with; a killed one leaves its shared memory behind.

    A listener hangs now and then while the middleware ends; nobody waits for that.
    """
    if process.poll() is None:
        process.terminate()
        try:
            process.communicate(timeout=GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def shared_memory(process):
    """The sizes of the shared memory that a process has mapped."""
    lines = Path(f'/proc/{process.pid}/maps').read_text().splitlines()
    ranges = [line.split()[0].split('-') for line in lines if '/dev/shm/' in line]
    return [int(last, 16) - int(first, 16) for first, last in ranges]


def end(process, number=signal.SIGINT):
    """End a player; its exit code and what it said on stderr."""
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE_S)
    return process.returncode, said


def bag_digests(path):
    """By topic and type the digest of each message of a bag, in order, as a subscriber has it."""
    digests = defaultdict(list)
    with open_messages(path) as messages:
        for message in messages:
            data = bytes(message.data)
            data += bytes(-len(data) % 4)  # what is of ROS 1 has no zeros at its end
            digests[message.topic, message.msgtype].append(hashlib.sha1(data).hexdigest())
    return dict(digests)
