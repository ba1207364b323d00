#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How punctual, light and fast the player is, beside bare loops over the same ready-made bytes.

    python benchmarks/play.py SRC [--repeat N] [--rounds N] [--subscribers N]

SRC is a KITTI drive. Player, subscribers and bare loop are processes of their own; a subscriber
takes raw bytes as fast as it can. Nothing leaves this machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from play_processes import open_program  # isort: skip
from yardsticks import make_parser, report  # isort: skip

if TYPE_CHECKING:
    from collections.abc import Callable

    from kitti_ros2.player.program import Program

ENVIRONMENT = {'ROS_DOMAIN_ID': '77', **os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
PROCESSES = Path(__file__).with_name('play_processes.py')


class Process:
    """One of the processes of play_processes.py; its result is the last line it prints."""

    def __init__(self, role: str, *words: str) -> None:
        self._role = role
        self._process = subprocess.Popen(
            [sys.executable, str(PROCESSES), role, *words],
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


def with_subscribers(
    count: int, topics: dict[str, str], player: Callable[[int], Process]
) -> tuple[Any, int]:
    """What a player returns, and how many messages some subscribers heard of it, all together."""
    subscribers = [Process('subscriber', json.dumps(topics)) for _ in range(count)]
    for subscriber in subscribers:
        subscriber.line()
    played = player(count).result()
    time.sleep(0.5)
    return played, sum(sum(subscriber.result().values()) for subscriber in subscribers)


def play(src: Path, topics: dict[str, str], **values: object) -> Callable[[int], Process]:
    """Starts a player, which begins when all topics have as many subscribers as it is given."""

    def start(subscribers: int) -> Process:
        options = {'subscribed': list(topics), 'subscribers': subscribers, **values}
        return Process('player', str(src), json.dumps(options))

    return start


def bare(src: Path, topics: dict[str, str], pace: str) -> Callable[[int], Process]:
    """Starts a bare loop, likewise."""
    return lambda subscribers: Process('bare', str(src), pace, str(subscribers), *topics)


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


def volatile(program: Program) -> dict[str, str]:
    """Return the types of the topics that are not latched, by name."""
    return {each.topic: each.msgtype for each in program.channels if not each.latched}


def measure_real_time(src: Path, repeat: int) -> None:
    """All topics at rate 1: punctual, and nothing lost."""
    program = open_program(src, raw=True)
    counts, topics = expected(program), volatile(program)
    half, most, timer, lost = [], [], [], 0
    for _ in range(repeat):
        beside = Process('timer', '15')
        played, heard = with_subscribers(1, topics, play(src, topics))
        half.append(quantile(played['late'], 0.5))
        most.append(quantile(played['late'], 0.99))
        timer.append(quantile(beside.result()['late'], 0.99))
        lost += sum(counts.values()) - heard
    report('schedule error p50, ms', median(half), '<= 0.5')
    report('schedule error p99, ms', median(most), '<= 3')
    note = f'the timer {median(timer):.2f} ms'
    report('p99 / p99 of a bare rclpy timer', median(most) / median(timer), '<= 1.3', note)
    report('messages that did not arrive', lost, '0', f'of {repeat * sum(counts.values())}')


def measure_load(src: Path, repeat: int, subscribers: int) -> None:
    """Compressed images and scans at rate 1, and as fast as can be."""
    topics = volatile(open_program(src, raw=False))
    cpu, bare_cpu = [], []
    for _ in range(repeat):
        played, _ = with_subscribers(1, topics, play(src, topics))
        cpu.append(played['cpu'] / played['wall'])
        played, _ = with_subscribers(1, topics, bare(src, topics, 'paced'))
        bare_cpu.append(played['cpu'] / played['wall'])
    report('one core busy at rate 1, share', median(cpu), '<= 0.4')
    ratio = median(cpu) / median(bare_cpu)
    report('the same / the bare loop', ratio, '<= 2.5', f'bare {median(bare_cpu):.2f}')
    measure_lossless(src, repeat, 1, '>= 0.7')
    measure_lossless(src, repeat, subscribers, '>= 0.85')


def measure_lossless(src: Path, repeat: int, subscribers: int, bound: str) -> None:
    """As fast as some subscribers can take it, and nothing lost."""
    program = open_program(src, raw=False)
    topics, frames = volatile(program), len(set(program.frames.tolist()))
    fast, bare_fast, ratios, lost = [], [], [], 0
    total = subscribers * sum(expected(program).values())
    for _ in range(repeat):
        played, heard = with_subscribers(subscribers, topics, play(src, topics, lossless=True))
        fast.append(frames / played['wall'])
        lost += total - heard
        played, _ = with_subscribers(subscribers, topics, bare(src, topics, 'flat out'))
        bare_fast.append(frames / played['wall'])
        ratios.append(fast[-1] / bare_fast[-1])
    note = f'{median(fast):.0f} of {median(bare_fast):.0f} frames/s; {subscribers} subscribers'
    report('lossless, frames/s / the bare loop', median(ratios), bound, note)
    report('messages lost by it', lost, '0', f'of {repeat * total}')


def measure_memory(src: Path, rounds: int) -> None:
    """Many rounds."""
    topics = volatile(open_program(src, raw=False))
    played, _ = with_subscribers(1, topics, play(src, topics, lossless=True, loop=rounds))
    memory = played['memory']
    tenth = max(1, len(memory) // 10)
    early = median(memory[tenth : 2 * tenth])
    late = median(memory[-tenth:])
    name = f'memory in the end / after 5 of {rounds} rounds'
    report(name, late / early, '<= 1.05', f'{late:.0f} MB')


def main() -> None:
    """Run all measures."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--repeat', type=int, default=3)
    parser.add_argument('--rounds', type=int, default=50, help='for the growth of memory')
    parser.add_argument('--subscribers', type=int, default=8, help='of the second lossless run')
    args = parser.parse_args()
    measure_real_time(args.src, args.repeat)
    measure_load(args.src, args.repeat, args.subscribers)
    measure_memory(args.src, args.rounds)


if __name__ == '__main__':
    main()
