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

HERE = Path(__file__).parent
MAIN = 'import sys; sys.argv[0] = "kitti-ros2"; from kitti_ros2.cli import main; sys.exit(main())'
DELETES = 'DELETEALL'


def environment():
    """Of our own processes: what they say stays on this machine, and among themselves."""
    return {**os.environ, 'PYTHONPATH': str(HERE.parents[1]), 'PYTHONUNBUFFERED': '1'}


def play(src, *options, **more):
    """Start a player."""
    words = [sys.executable, '-c', MAIN, 'play', *([str(src)] if src else []), *map(str, options)]
    return subprocess.Popen(
        words, env=environment(), text=True, stdin=subprocess.DEVNULL,
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

    def ask(self, *words):
        """What it answers to a line, and when it did."""
        self.process.stdin.write(' '.join(map(str, words)) + '\n')
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def tell(self, *words):
        """What it answers to a line."""
        return self.ask(*words)[1]

    def wait_for_publishers(self):
        """Until every topic has one."""
        for topic in self.topics:
            for _ in range(200):
                if self.tell('publishers', topic):
                    break
                subprocess.run(['sleep', '0.05'], check=True)
            else:
                raise AssertionError(f'nobody publishes {topic}')
        subprocess.run(['sleep', '0.5'], check=True)  # for the other direction of the discovery

    def heard(self):
        """End it; by topic when each message came, and its digest."""
        self.process.stdin.close()
        heard = json.loads(self.process.stdout.read().splitlines()[-1])
        assert self.process.wait(10) == 0
        return heard


class Recording:
    """A process that subscribes as `ros2 bag record -a` does, so many seconds late."""

    def __init__(self, late_s):
        words = [sys.executable, str(HERE / 'recorder.py'), str(late_s)]
        self.process = subprocess.Popen(
            words, env=environment(), text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def counts(self):
        """End it; by topic how many messages came."""
        said, _ = self.process.communicate(timeout=30)
        return json.loads(said.splitlines()[-1])


def stop(process):
    """End a process that a test is done with; a killed one leaves its shared memory behind."""
    if process.poll() is None:
        process.terminate()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def end(process, number=signal.SIGINT):
    """End a player; its exit code and what it said on stderr."""
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
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
