#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How much faster one drive becomes a bag on several cores: by threads, and by processes.

    python benchmarks/split_drive.py SRC [--jobs N] [--repeat N] [--dir FOLDER]

Each line is the ratio of medians of seconds: one core without --jobs over N cores, whose threads
are those without --jobs, and whose processes those of --jobs N. They take turns, so that a busy
moment meets all. The note has the CPU seconds of both, which suffer less from other programs. The
bags are compared, byte for byte.
"""

from __future__ import annotations

import hashlib
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

from yardsticks import COMMAND, fresh, make_parser, report  # isort: skip

CASES = {
    'PNG passed through': (),
    'PNG passed through, zstd': ('--compression', 'zstd'),
    '--images raw': ('--images', 'raw'),
    '--images raw, zstd': ('--images', 'raw', '--compression', 'zstd'),
}


class Cost(NamedTuple):
    """The cost of a run: seconds, and CPU seconds of all its processes."""

    seconds: float
    cpu: float


def convert(src: Path, out: Path, cores: int, words: tuple[str, ...]) -> tuple[Cost, str]:
    """Run to-bag on a number of cores; return its cost and the digest of its bag."""
    chosen = sorted(os.sched_getaffinity(0))[:cores]
    fresh(out)
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        ['taskset', '-c', ','.join(map(str, chosen)), *COMMAND, 'to-bag', src, out, '-q', *words],
        check=True,
    )
    elapsed, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    digest = hashlib.sha256()
    with out.open('rb') as file:
        while data := file.read(1 << 24):
            digest.update(data)
    fresh(out)
    return Cost(elapsed, cpu), digest.hexdigest()


def main() -> None:
    """Run all measures."""
    parser = make_parser(__doc__)
    parser.add_argument('src', type=Path)
    parser.add_argument('--jobs', type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument('--repeat', type=int, default=3)
    parser.add_argument('--dir', type=Path, help='where to write; on the disk of SRC by default')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.dir or args.src.resolve().parent.parent) as folder:
        out = Path(folder) / 'out.mcap'
        for case, options in CASES.items():
            ways = {
                'one core': (1, options),
                'threads': (args.jobs, options),
                'processes': (args.jobs, (*options, '--jobs', str(args.jobs))),
            }
            costs: dict[str, list[Cost]] = {way: [] for way in ways}
            digests = set()
            for _ in range(args.repeat):
                for way, (cores, words) in ways.items():
                    cost, digest = convert(args.src, out, cores, words)
                    costs[way].append(cost)
                    digests.add(digest)
            if len(digests) > 1:
                raise SystemExit(f'{case}: the bags differ')
            one = costs.pop('one core')
            for way, found in costs.items():
                ratio = median(each.seconds for each in one) / median(
                    each.seconds for each in found
                )
                spent = [median(each.cpu for each in costs) for costs in (one, found)]
                note = f'CPU {spent[0]:.1f} s on one core, {spent[1]:.1f} s on {args.jobs}'
                report(f'{case}: one core / {way} on {args.jobs}', ratio, '', note)


if __name__ == '__main__':
    main()
