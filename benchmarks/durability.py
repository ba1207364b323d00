#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What it costs that outputs outlast a power cut: each command with fsync and with --no-fsync.

    python benchmarks/durability.py SRC [--repeat N] [--dir FOLDER] [--container NAME ...]

SRC is a KITTI drive; one of 480 frames makes a bag of 1.6 GB. The two take
turns, the first of them alternating. Before each run all files are on the disk. A run without fsync
ends while its output is still in memory, so that the cost includes writing what another program
would wait for later: the last column says how long os.sync takes after such a run.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path
from statistics import median

from yardsticks import COMMAND, fresh, make_parser, report, seconds, tree_bytes  # isort: skip

AIM = '<= 1.10'
OUTPUTS = {'mcap': 'o.mcap', 'sqlite3': 'o', 'ros1': 'o.bag'}


def run(*words: str) -> float:
    """Seconds of a command."""
    return seconds(lambda: subprocess.run([*COMMAND, *words, '-q'], check=True))


def in_turns(
    out: Path, words: tuple[str, ...], repeat: int
) -> tuple[list[float], list[float], float]:
    """Seconds with and without fsync, and of os.sync after runs without it."""
    durable: list[float] = []
    fast: list[float] = []
    late: list[float] = []
    for turn in range(repeat):
        for fsync in ((True, False), (False, True))[turn % 2]:
            fresh(out)
            os.sync()
            taken = run(*words, '--fsync' if fsync else '--no-fsync')
            (durable if fsync else fast).append(taken)
            if not fsync:
                late.append(seconds(os.sync))
    return durable, fast, median(late)


def measure(name: str, out: Path, words: tuple[str, ...], repeat: int) -> None:
    """One line: the ratio, and both times."""
    durable, fast, late = in_turns(out, words, repeat)
    note = (
        f'{median(durable):.2f} s / {median(fast):.2f} s, {tree_bytes(out) / 1e9:.2f} GB;'
        f' os.sync without it {late:.2f} s'
    )
    report(f'{name}, fsync / --no-fsync', median(durable) / median(fast), AIM, note)


def main() -> None:
    """Run all measures."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--repeat', type=int, default=5)
    parser.add_argument('--dir', type=Path, help='where to write; on the disk of SRC by default')
    parser.add_argument('--container', nargs='*', choices=OUTPUTS, default=[*OUTPUTS])
    parser.add_argument('--images', default='compressed', help='those of the bags')
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.dir or given.src.resolve().parent.parent) as name:
        folder = Path(name)
        for container in given.container:
            out = folder / OUTPUTS[container]
            storage = ('--storage', container, '--images', given.images)
            measure(
                f'to-bag {container}',
                out,
                ('to-bag', str(given.src), str(out), *storage),
                given.repeat,
            )
            fresh(out)
        bag = folder / 'own.mcap'
        run('to-bag', str(given.src), str(bag))
        out = folder / 'again'
        measure('to-kitti, its many files', out, ('to-kitti', str(bag), str(out)), given.repeat)
        out = folder / 'recovered.mcap'
        measure('recover', out, ('recover', str(bag), str(out)), given.repeat)


if __name__ == '__main__':
    main()
