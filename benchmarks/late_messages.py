#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How many messages are late while subscribers come and go: of the player, and of a bare publisher.

    python benchmarks/late_messages.py [--minutes M] [--rate R] [--health-check MS ...]

Each run is one of python -m tests.torture.soak with 8 subscribers. Beside the player run a
publisher of one small message with the same middleware, which shows what that misses by itself, and
a timer, which shows what the machine does. While Fast DDS opens the shared memory of a new
subscriber it holds a lock of the publisher, and sleeps there by the healthy_check_timeout_ms of
the subscriber: the runs differ in that setting, "default" being the middleware's own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import kitti_ros2

from yardsticks import make_parser, report  # isort: skip

ROOT = Path(__file__).resolve().parent.parent
PROFILE = Path(kitti_ros2.__file__).parent / 'player' / 'fastdds.xml'
SHARED_MEMORY = '<type>SHM</type>'
DEFAULT = 'default'
LATE = 'late_over_50_ms_in_10_000'


def write_profile(folder: Path, milliseconds: str) -> Path:
    """The player's profile of Fast DDS with a health check, for all processes of a run."""
    before, kind, after = PROFILE.read_text().partition(SHARED_MEMORY)
    if not kind:
        raise SystemExit(f'{PROFILE}: no {SHARED_MEMORY}, which the health check belongs to')
    check = f'<healthy_check_timeout_ms>{milliseconds}</healthy_check_timeout_ms>'
    path = folder / f'fastdds_{milliseconds}.xml'
    path.write_text(before + kind + check + after)
    return path


def soak(words: list[str], profile: Path | None) -> dict[str, Any]:
    """The figures of one run."""
    environment = {**os.environ, 'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp'}
    if profile:
        environment['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profile)
    ended = subprocess.run(
        [sys.executable, '-m', 'tests.torture.soak', *words],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        check=False,
    )
    if ended.returncode:
        raise SystemExit(f'the soak failed: {ended.stdout.decode()}')
    figures: dict[str, Any] = json.loads(ended.stdout)
    return figures


def main() -> None:
    """Run each setting, and print its lines."""
    parser = make_parser(__doc__)
    parser.add_argument('--minutes', default='2.5', help='of each run')
    parser.add_argument('--rate', default='1')
    parser.add_argument('--health-check', nargs='+', default=[DEFAULT, '30'], metavar='MS')
    given = parser.parse_args()
    words = ['--minutes', given.minutes, '--rate', given.rate]
    with tempfile.TemporaryDirectory() as name:
        for check in given.health_check:
            profile = None if check == DEFAULT else write_profile(Path(name), check)
            found = soak(words, profile)
            for who, prefix in (('timer', 'timer_'), ('publisher', 'publisher_'), ('player', '')):
                bound = '' if prefix else '<= 1'
                note = f'in 10,000 messages; at most {found[f"{prefix}worst_ms"]} ms'
                report(f'{check}: {who}, over 50 ms late', found[prefix + LATE], bound, note)
            beside = found['publisher_' + LATE]
            if beside:
                report(f'{check}: player / publisher', found[LATE] / beside, '<= 1')


if __name__ == '__main__':
    main()
