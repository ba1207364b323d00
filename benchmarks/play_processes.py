#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The processes that benchmarks/play.py measures: each prints its result as JSON, on its last line.

    python benchmarks/play_processes.py ROLE WORD...

player SRC VALUES, bare SRC PACE SUBSCRIBERS TOPIC..., timer SECONDS, subscriber TOPICS.
"""

from __future__ import annotations

import json
import resource
import sys
import threading
import time
from array import array
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from kitti_ros2.cli.exits import end_by_signal
from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.player import node
from kitti_ros2.player.message_types import message_class
from kitti_ros2.player.middleware import start_ros
from kitti_ros2.player.node import KittiPlayer
from kitti_ros2.player.outlets import Outlets
from kitti_ros2.player.program import RecordingProgram
from kitti_ros2.player.run import run_player
from kitti_ros2.player.session import Session

if TYPE_CHECKING:
    from collections.abc import Callable

    from kitti_ros2.player.program import Program

WINDOW = 9
"""Messages in flight on a topic, one less than its queue holds."""
TAKE_BYTES = True
CLOCK_PERIOD_NS = 10_000_000
CLOCK_BYTES = bytes([0, 1, 0, 0, *range(8)])


class Usage:
    """Seconds of processor that this process has taken."""

    def __init__(self) -> None:
        self.wall = time.monotonic()
        self.cpu = self._cpu()

    @staticmethod
    def _cpu() -> float:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        return usage.ru_utime + usage.ru_stime

    def since(self) -> dict[str, float]:
        """Wall and processor seconds since this object was made."""
        return {'wall': time.monotonic() - self.wall, 'cpu': self._cpu() - self.cpu}


def memory_mb() -> float:
    """What this process holds in memory now."""
    pages = int(Path('/proc/self/statm').read_text('ascii').split()[1])
    return pages * resource.getpagesize() / 1e6


def open_program(src: Path, *, raw: bool) -> Program:
    """The program that is measured."""
    options = MessageOptions(images=Images.BOTH if raw else Images.COMPRESSED)
    return RecordingProgram(open_recording(src), options, SelectionOptions(), 1)


def be_player(src: Path, values: dict[str, Any]) -> dict[str, Any]:
    """Play; how late each message was, what it cost, and memory round by round."""
    late = array('q')  # which grows little over many rounds
    memory: list[float] = []
    begun: list[Usage] = []
    used: dict[str, float] = {}

    def on_publish(_outlet: int, due_ns: int, now_ns: int) -> None:
        if not begun:
            begun.append(Usage())
        late.append(now_ns - due_ns)

    class Measured(Outlets):
        """Ends the measurement when all is acknowledged, as in the bare loop."""

        def finish(self, seconds: float) -> tuple[str, ...]:
            late_topics = super().finish(seconds)
            used.update(begun[0].since())
            return late_topics

    def sample() -> None:
        while True:
            memory.append(memory_mb())
            time.sleep(0.2)

    Session.on_publish = staticmethod(on_publish)
    node.Outlets = Measured  # type: ignore[attr-defined]
    keep_freed_memory()
    if values.get('loop', 1) > 1:
        threading.Thread(target=sample, daemon=True).start()
    subscribers, subscribed = values.pop('subscribers'), values.pop('subscribed')
    start = KittiPlayer.start

    def start_and_resume(player: KittiPlayer) -> None:
        start(player)
        threading.Thread(target=resume, args=(player,), daemon=True).start()

    def resume(player: KittiPlayer) -> None:
        wait_until_matched(player, subscribed, subscribers)
        player.playback.resume()

    KittiPlayer.start = start_and_resume  # type: ignore[method-assign, assignment]
    values = {'source': str(src), 'start_paused': True, **values}
    run_player(values, [], end_by_signal(), keyboard=False)
    return {'late': late.tolist(), 'memory': memory, **used}


def wait_until_matched(publishing: Node, topics: list[str], subscribers: int) -> None:
    """Wait until every topic is connected to all its subscribers, and both sides know."""
    publishers = [each for each in publishing.publishers if each.topic_name in topics]
    while any(each.get_subscription_count() < subscribers for each in publishers):
        time.sleep(0.05)
    time.sleep(1.0)


def be_bare(src: Path, topics: list[str], subscribers: int, *, paced: bool) -> dict[str, Any]:
    """Publish the same bytes, made before, in time or as fast as they are taken."""
    program = open_program(src, raw=False)
    outlets = frozenset(range(len(program.channels)))
    ready = [program.fetch(index, outlets)[0] for index in range(len(program.stamps_ns))]
    context = start_ros([])
    publishing = Node('bare', context=context)
    group = Outlets(publishing, program, {}, lambda _: None)
    publishers = group._publishers  # noqa: SLF001 - nothing of ours but the topics
    clock = publishing.create_publisher(Clock, '/clock', 10)
    wait_until_matched(publishing, topics, subscribers)
    usage, begin = Usage(), time.monotonic_ns()
    tick = begin
    for position, messages in enumerate(ready):
        if paced:
            due = begin + int(program.stamps_ns[position] - program.stamps_ns[0])
            while tick < due:  # /clock is among what the player publishes
                time.sleep(max(0, tick - time.monotonic_ns()) / 1e9)
                clock.publish(CLOCK_BYTES)
                tick += CLOCK_PERIOD_NS
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
        for message in messages:
            publishers[message.channel].publish(message.data)
        if not paced and position % (WINDOW * 7) == 0:
            for publisher in publishers.values():
                publisher.wait_for_all_acked(Duration(seconds=5))
    for publisher in publishers.values():
        publisher.wait_for_all_acked(Duration(seconds=5))
    result = usage.since()
    context.try_shutdown()
    return result


def be_timer(seconds: float) -> dict[str, Any]:
    """A bare rclpy timer of 100 Hz: how late it is called."""
    rclpy.init()
    timing = rclpy.create_node('timer')
    begin = time.monotonic_ns()
    late: list[int] = []
    count = 0

    def call() -> None:
        nonlocal count
        count += 1
        late.append(time.monotonic_ns() - begin - count * 10_000_000)

    timing.create_timer(0.01, call)
    begin = time.monotonic_ns()
    executor = SingleThreadedExecutor()
    executor.add_node(timing)
    while time.monotonic_ns() - begin < seconds * 1e9:
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()
    return {'late': late}


def be_subscriber(topics: dict[str, str]) -> dict[str, int]:
    """Count what comes; ends with its standard input."""
    rclpy.init()
    listening = rclpy.create_node('subscriber')
    profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
    subscriptions = {
        topic: listening.create_subscription(
            message_class(msgtype, TYPESTORE), topic, lambda _: None, profile, raw=True
        )
        for topic, msgtype in topics.items()
    }
    counts = dict.fromkeys(topics, 0)
    ended = threading.Event()
    threading.Thread(target=_end_with_input, args=(ended,), daemon=True).start()
    sys.stdout.write('ready\n')
    sys.stdout.flush()
    while not ended.is_set():
        before = sum(counts.values())
        for topic, subscription in subscriptions.items():
            while subscription.handle.take_message(subscription.msg_type, TAKE_BYTES):
                counts[topic] += 1
        if sum(counts.values()) == before:
            time.sleep(0.002)
    return counts


def _end_with_input(ended: threading.Event) -> None:
    sys.stdin.read()
    ended.set()


def main() -> None:
    """Be one of the processes, and print its result."""
    role, *words = sys.argv[1:]
    roles: dict[str, Callable[[], Any]] = {
        'player': lambda: be_player(Path(words[0]), json.loads(words[1])),
        'bare': lambda: be_bare(
            Path(words[0]), words[3:], int(words[2]), paced=words[1] == 'paced'
        ),
        'timer': lambda: be_timer(float(words[0])),
        'subscriber': lambda: be_subscriber(json.loads(words[0])),
    }
    print(json.dumps(roles[role]()), flush=True)


if __name__ == '__main__':
    main()
