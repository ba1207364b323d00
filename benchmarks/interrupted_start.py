#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C right after the start of kitti-ros2 play: how often a traceback is printed.

    python benchmarks/interrupted_start.py SRC [--starts 60] [--until 0.1]

SIGINT comes at moments that are spread evenly over the first part of a second. "Bare Python" is a
program whose first statement ends it at SIGINT without a word: what it prints comes from Python's
own start, before any statement of a program is run. The two take turns. Between Python's start and
the first statement of kitti_ros2.__main__, for 1 or 2 ms, the package itself is imported.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import kitti_ros2

from yardsticks import COMMAND, make_parser, report  # isort: skip

BARE = (
    sys.executable,
    '-c',
    'import signal; signal.signal(signal.SIGINT, signal.SIG_DFL); import time; time.sleep(10)',
)
PACKAGE = os.path.join(str(Path(kitti_ros2.__file__).parent), '')  # noqa: PTH118 - ends in a slash


def interrupt(command: tuple[str, ...], after_s: float) -> str:
    """The traceback on stderr of a program that gets SIGINT, or nothing."""
    begun = time.perf_counter()
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        time.sleep(max(0.0, begun + after_s - time.perf_counter()))
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    return said if 'KeyboardInterrupt' in said else ''


def main() -> None:
    """Measure."""
    parser = make_parser(__doc__)
    parser.add_argument('src')
    parser.add_argument('--starts', type=int, default=60)
    parser.add_argument('--until', type=float, default=0.1, help='the last moment, seconds')
    chosen = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    programs = {
        'bare Python': BARE,
        'kitti-ros2 play': (*COMMAND, 'play', chosen.src, '--no-keyboard'),
    }
    printed: dict[str, dict[float, str]] = {name: {} for name in programs}
    for turn in range(chosen.starts):
        after_s = chosen.until * (turn + 1) / chosen.starts
        for name, command in programs.items():
            if said := interrupt(command, after_s):
                printed[name][after_s] = said
    for name, texts in printed.items():
        note = f'of {chosen.starts}, the last at {max(texts, default=0):.3f} s'
        report(f'{name}: tracebacks', len(texts), '', note)
    ours = sum(PACKAGE in text for text in printed['kitti-ros2 play'].values())
    report('of these from a file of kitti_ros2', ours, '')


if __name__ == '__main__':
    main()
