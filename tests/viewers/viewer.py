# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A viewer: a client of Foxglove's WebSocket protocol, over websockets, and a player for it.

The protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md, and for playback
control rust/foxglove/src/protocol of https://github.com/foxglove/foxglove-sdk. Text is JSON; binary
begins with an opcode, all numbers little-endian.
"""

import json
import os
import re
import struct
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from waiting import PATIENCE_S  # isort: skip

ROOT = Path(__file__).resolve().parents[2]
MAIN = (
    'import sys; sys.argv[0] = "kitti-ros2"; sys.modules["rclpy"] = None;'  # as if there were none
    ' from kitti_ros2.cli import main; sys.exit(main())'
)

MESSAGE, TIME, PLAYBACK = 1, 2, 5
"""Opcodes of a server."""
CONTROL = 3
"""Opcode of a client."""
PLAY, PAUSE = 0, 1
PLAYING, PAUSED, ENDED = 0, 1, 3
"""Status of a playback."""


class Message(NamedTuple):
    topic: str
    log_time: int
    data: bytes


class State(NamedTuple):
    status: int
    time: int
    rate: float
    did_seek: bool
    request: str


class Viewer:
    """One connection; what it receives is sorted into messages, states and times.

    Args:
        url: Of the server.
        queue: How much is taken from the socket before it is asked for; None is everything.
    """

    def __init__(self, url, queue=None):
        self._open = ExitStack()
        # Pings are answered by a thread that a full queue stops: a viewer that does not read would
        # close its connection itself after 40 s.
        options = {'max_size': None, 'max_queue': queue, 'compression': None, 'ping_interval': None}
        connection = connect(url, subprotocols=['foxglove.sdk.v1'], **options)
        self.socket = self._open.enter_context(connection)
        self.messages, self.states, self.times, self.statuses = [], [], [], []
        self.channels = {}
        self.info = None
        self._topics = {}
        self._requests = 0
        self.until(lambda: self.info and self.channels)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._open.close()

    def receive(self, seconds):
        """Whether something came within a time."""
        try:
            data = self.socket.recv(timeout=max(0, seconds))
        except TimeoutError:
            return False
        if isinstance(data, str):
            self._text(json.loads(data))
        elif data[0] == MESSAGE:
            subscription, log_time = struct.unpack_from('<IQ', data, 1)
            topic = self._topics[subscription]
            self.messages.append(Message(topic, log_time, data[13:]))
        elif data[0] == TIME:
            self.times.append(struct.unpack_from('<Q', data, 1)[0])
        elif data[0] == PLAYBACK:
            status, current, rate, did_seek, length = struct.unpack_from('<BQfBI', data, 1)
            request = data[19 : 19 + length].decode()
            self.states.append(State(status, current, round(rate, 6), bool(did_seek), request))
        return True

    def _text(self, message):
        if message['op'] == 'serverInfo':
            self.info = message
        elif message['op'] == 'advertise':
            self.channels |= {each['topic']: each for each in message['channels']}
        elif message['op'] == 'status':
            self.statuses.append(message)

    def until(self, condition, seconds=PATIENCE_S):
        """Receive until a condition holds."""
        end = time.monotonic() + seconds
        while not condition():
            assert self.receive(end - time.monotonic()) or condition(), 'it did not come'

    def hear_ticks(self, count):
        """Receive until the server's time was announced so many times more."""
        heard = len(self.times)
        self.until(lambda: len(self.times) >= heard + count)

    def listen_to_the_end(self):
        """Receive until the server goes away."""
        with suppress(ConnectionClosed):
            self.until(lambda: False)

    def subscribe(self, *topics):
        """Subscribe to some topics, or to all."""
        wanted = [self.channels[topic] for topic in topics or self.channels]
        self._topics |= {each['id']: each['topic'] for each in wanted}
        subscriptions = [{'id': each['id'], 'channelId': each['id']} for each in wanted]
        self._say({'op': 'subscribe', 'subscriptions': subscriptions})

    def unsubscribe(self, *topics):
        ids = [self.channels[topic]['id'] for topic in topics]
        self._say({'op': 'unsubscribe', 'subscriptionIds': ids})

    def _say(self, message):
        self.socket.send(json.dumps(message))

    def control(self, command, rate=1.0, seek=None):
        """Use the play controls; the server's answer."""
        self._requests += 1
        name = f'request {self._requests}'
        head = struct.pack(
            '<BBfBQI', CONTROL, command, rate, seek is not None, seek or 0, len(name)
        )
        self.socket.send(head + name.encode())
        self.until(lambda: any(state.request == name for state in self.states))
        return next(state for state in self.states if state.request == name)

    def of(self, topic):
        """The messages of a topic so far."""
        return [message for message in self.messages if message.topic == topic]

    @property
    def range(self):
        """First and last time of what is played, nanoseconds."""
        begin, end = self.info['dataStartTime'], self.info['dataEndTime']
        return tuple(each['sec'] * 1_000_000_000 + each['nsec'] for each in (begin, end))


class Player:
    """`kitti-ros2 play --foxglove` as a process."""

    def __init__(self, src, *options, port=0):
        words = [sys.executable, '-c', MAIN, 'play', str(src), *options, '--foxglove', str(port)]
        self.process = subprocess.Popen(
            words, env={**os.environ, 'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'}, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        self.said = [self.process.stdout.readline(), self.process.stdout.readline()]
        found = re.search(r'ws://127\.0\.0\.1:(\d+)', self.said[1])
        self.url, self.port = (found[0], int(found[1])) if found else (None, None)

    def end(self, number=None):
        """End it, or wait for its end; exit code and what it complained of."""
        if number is not None:
            self.process.send_signal(number)
        _, complaints = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, complaints
