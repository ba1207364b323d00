#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How punctual, light and fast the player is, beside bare loops over the same ready-made bytes.

    python benchmarks/play.py SRC [--repeat N] [--rounds N]

SRC is a KITTI drive. Player, subscriber and bare loop are processes of their own; the subscriber
takes raw bytes as fast as it can. Nothing leaves this machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import threading
import time
from array import array
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock

from kitti_ros2.cli.ending import end_by_signal
from kitti_ros2.cli.memory import keep_freed_memory
from kitti_ros2.kitti.layouts import open_recording
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.node.message_types import message_class
from kitti_ros2.node.middleware import start_ros
from kitti_ros2.node.outlets import Outlets
from kitti_ros2.node.player import KittiPlayer
from kitti_ros2.node.run import run_player
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.selection import SelectionOptions
from kitti_ros2.player.program import RecordingProgram
from kitti_ros2.player.session import Session

from yardsticks import make_parser, report  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable

    from kitti_ros2.player.program import Program

ENVIRONMENT = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_DOMAIN_ID': '77'}

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


# The processes.


def be_player(src: Path, values: dict[str, Any]) -> dict[str, Any]:
    """Play; how late each message was, what it cost, and memory round by round."""
    late = array('q')  # which grows little over many rounds
    memory: list[float] = []
    begun: list[Usage] = []
    latest: list[dict[str, float]] = [{}]

    def on_publish(_outlet: int, due_ns: int, now_ns: int) -> None:
        if not begun:
            begun.append(Usage())
        late.append(now_ns - due_ns)
        latest[0] = begun[0].since()

    def sample() -> None:
        while True:
            memory.append(memory_mb())
            time.sleep(0.2)

    Session.on_publish = staticmethod(on_publish)
    keep_freed_memory()
    if values.get('loop', 1) > 1:
        threading.Thread(target=sample, daemon=True).start()
    subscribed = values.pop('subscribed')
    start = KittiPlayer.start

    def start_and_resume(player: KittiPlayer) -> None:
        start(player)
        threading.Thread(target=_resume, args=(player, subscribed), daemon=True).start()

    KittiPlayer.start = start_and_resume  # type: ignore[method-assign, assignment]
    values = {'source': str(src), 'start_paused': True, **values}
    run_player(values, [], end_by_signal(), keyboard=False)
    return {'late': late.tolist(), 'memory': memory, **latest[0]}


def _resume(player: KittiPlayer, topics: list[str]) -> None:
    """Begin when every topic has its subscriber."""
    while not all(player.count_subscribers(topic) for topic in topics):
        time.sleep(0.05)
    time.sleep(1.0)
    player.playback.resume()


def be_bare(src: Path, topics: list[str], *, paced: bool) -> dict[str, Any]:
    """Publish the same bytes, made before, in time or as fast as they are taken."""
    program = open_program(src, raw=False)
    outlets = frozenset(range(len(program.channels)))
    ready = [program.fetch(index, outlets)[0] for index in range(len(program.stamps_ns))]
    context = start_ros([])
    node = Node('bare', context=context)
    group = Outlets(node, program, {}, lambda _: None)
    publishers = group._publishers  # noqa: SLF001 - nothing of ours but the topics
    clock = node.create_publisher(Clock, '/clock', 10)
    while not all(node.count_subscribers(topic) for topic in topics):
        time.sleep(0.05)
    time.sleep(1.0)
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
    node = rclpy.create_node('timer')
    begin = time.monotonic_ns()
    late: list[int] = []
    count = 0

    def call() -> None:
        nonlocal count
        count += 1
        late.append(time.monotonic_ns() - begin - count * 10_000_000)

    node.create_timer(0.01, call)
    begin = time.monotonic_ns()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while time.monotonic_ns() - begin < seconds * 1e9:
        executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()
    return {'late': late}


def be_subscriber(topics: dict[str, str]) -> dict[str, int]:
    """Count what comes; ends with its standard input."""
    rclpy.init()
    node = rclpy.create_node('subscriber')
    profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
    subscriptions = {
        topic: node.create_subscription(
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


# What is measured.


class Process:
    """One of the processes above; its result is the last line it prints."""

    def __init__(self, role: str, *words: str) -> None:
        self._role = role
        self._process = subprocess.Popen(
            [sys.executable, __file__, '--role', role, *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )

    def line(self) -> str:
        """The next line it prints."""
        return self._process.stdout.readline() if self._process.stdout else ''

    def result(self) -> Any:  # noqa: ANN401 - whatever the role returns
        """Wait for it."""
        out, _ = self._process.communicate(timeout=600)
        if self._process.returncode:
            raise SystemExit(f'{self._role} failed')
        return json.loads(out.splitlines()[-1])


def with_subscriber(
    topics: dict[str, str], player: Callable[[], Process]
) -> tuple[Any, dict[str, int]]:
    """What a player returns, and what a subscriber heard of it."""
    subscriber = Process('subscriber', json.dumps(topics))
    subscriber.line()
    playing = player()
    played = playing.result()
    time.sleep(0.5)
    return played, subscriber.result()


def play(src: Path, topics: dict[str, str], **values: object) -> Callable[[], Process]:
    """Starts a player, which begins when all topics are subscribed."""
    options = json.dumps({'subscribed': list(topics), **values})
    return lambda: Process('player', str(src), options)


def bare(src: Path, topics: dict[str, str], pace: str) -> Callable[[], Process]:
    """Starts a bare loop."""
    return lambda: Process('bare', str(src), pace, *topics)


def quantile(values: list[int], share: float) -> float:
    """Of nanoseconds, in milliseconds."""
    return sorted(values)[int(share * (len(values) - 1))] / 1e6


def expected(program: Program) -> dict[str, int]:
    """Messages of each volatile topic."""
    counts: dict[str, int] = {}
    everything = frozenset(range(len(program.channels)))
    for index in range(len(program.stamps_ns)):
        for message in program.fetch(index, everything)[0]:
            outlet = program.channels[message.channel]
            if not outlet.latched:
                counts[outlet.topic] = counts.get(outlet.topic, 0) + 1
    return counts


def measure_real_time(src: Path, repeat: int) -> None:
    """All topics at rate 1: punctual, and nothing lost."""
    counts = expected(open_program(src, raw=True))
    types = {each.topic: each.msgtype for each in open_program(src, raw=True).channels}
    topics = {name: types[name] for name in counts}
    half, most, timer, lost = [], [], [], 0
    for _ in range(repeat):
        beside = Process('timer', '15')
        played, heard = with_subscriber(topics, play(src, topics))
        half.append(quantile(played['late'], 0.5))
        most.append(quantile(played['late'], 0.99))
        timer.append(quantile(beside.result()['late'], 0.99))
        lost += sum(counts.values()) - sum(heard.values())
    report('schedule error p50, ms', median(half), '<= 0.5')
    report('schedule error p99, ms', median(most), '<= 3')
    note = f'the timer {median(timer):.2f} ms'
    report('p99 / p99 of a bare rclpy timer', median(most) / median(timer), '<= 2', note)
    report('messages that did not arrive', lost, '0', f'of {repeat * sum(counts.values())}')


def measure_load(src: Path, repeat: int) -> None:
    """Compressed images and scans at rate 1, and as fast as can be."""
    program = open_program(src, raw=False)
    topics = {each.topic: each.msgtype for each in program.channels if not each.latched}
    frames = len(set(program.frames.tolist()))
    cpu, bare_cpu, fast, bare_fast, lost = [], [], [], [], 0
    total = sum(expected(program).values())
    for _ in range(repeat):
        played, _ = with_subscriber(topics, play(src, topics))
        cpu.append(played['cpu'] / played['wall'])
        played, _ = with_subscriber(topics, bare(src, topics, 'paced'))
        bare_cpu.append(played['cpu'] / played['wall'])
        played, heard = with_subscriber(topics, play(src, topics, lossless=True))
        fast.append(frames / played['wall'])
        lost += total - sum(heard.values())
        played, _ = with_subscriber(topics, bare(src, topics, 'flat out'))
        bare_fast.append(frames / played['wall'])
    report('one core busy at rate 1, share', median(cpu), '<= 0.4')
    ratio = median(cpu) / median(bare_cpu)
    report('the same / the bare loop', ratio, '<= 2.5', f'bare {median(bare_cpu):.2f}')
    ratio = median(fast) / median(bare_fast)
    note = f'{median(fast):.0f} of {median(bare_fast):.0f} frames/s'
    report('lossless, frames/s / the bare loop', ratio, '>= 0.6', note)
    report('messages lost by it', lost, '0', f'of {repeat * total}')


def measure_memory(src: Path, rounds: int) -> None:
    """Many rounds."""
    program = open_program(src, raw=False)
    topics = {each.topic: each.msgtype for each in program.channels if not each.latched}
    played, _ = with_subscriber(topics, play(src, topics, lossless=True, loop=rounds))
    memory = played['memory']
    tenth = max(1, len(memory) // 10)
    early = median(memory[tenth : 2 * tenth])
    late = median(memory[-tenth:])
    name = f'memory in the end / after 5 of {rounds} rounds'
    report(name, late / early, '<= 1.05', f'{late:.0f} MB')


def main() -> None:
    """Run all measures, or one of the processes."""
    parser = make_parser(__doc__)
    parser.add_argument('src', nargs='+')
    parser.add_argument('--repeat', type=int, default=3)
    parser.add_argument('--rounds', type=int, default=50, help='for the growth of memory')
    parser.add_argument('--role', help=argparse.SUPPRESS)
    args = parser.parse_args()
    src = Path(args.src[0])
    roles: dict[str, Callable[[], Any]] = {
        'player': lambda: be_player(src, json.loads(args.src[1])),
        'bare': lambda: be_bare(src, args.src[2:], paced=args.src[1] == 'paced'),
        'timer': lambda: be_timer(float(args.src[0])),
        'subscriber': lambda: be_subscriber(json.loads(args.src[0])),
    }
    if args.role:
        result = roles[args.role]()
        print(json.dumps(result), flush=True)
        return
    measure_real_time(src, args.repeat)
    measure_load(src, args.repeat)
    measure_memory(src, args.rounds)


if __name__ == '__main__':
    main()
