#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How kitti-ros2 to-bag --all scales: worker processes, and the overhead of tiny units.

    python benchmarks/whole_collections.py [--units N] [--drives N] [--frames N] [--dir FOLDER]

Synthetic drives with --images raw: --jobs 1 on one CPU beside --jobs 2 with one thread each, and
the plain command on each drive; the bytes of all must be equal. Then N units of one tiny frame:
time per unit beside that of the bare conversions in one process, and of a rerun that skips all.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from kitti_ros2.batch.bag_unit import run_bag_unit
from kitti_ros2.batch.results import UnitJob
from kitti_ros2.batch.units import find_units
from kitti_ros2.model.layouts import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

TINY = SyntheticOptions(frames=1, image_size=(62, 20), lidar_columns=20)


def make_root(folder: Path, drives: int, options: SyntheticOptions) -> Path:
    """Write so many copies of a synthetic drive."""
    drive = write_synthetic(folder, Layout.RAW, options)
    for number in range(2, drives + 1):
        shutil.copytree(drive, drive.with_name(drive.name.replace('0001', f'{number:04d}')))
    return folder


def seconds(*words: str | Path, cpus: set[int] | None = None) -> float:
    """Run kitti-ros2 to-bag on some CPUs; return the seconds taken."""
    command = [sys.executable, '-m', 'kitti_ros2', 'to-bag', *map(str, words), '-q']
    everything = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cpus or everything)
    try:
        started = time.perf_counter()
        subprocess.run(command, check=True)
        return time.perf_counter() - started
    finally:
        os.sched_setaffinity(0, everything)


def same(one: Path, other: Path) -> bool:
    """Whether two folders hold the same bags."""
    names = [path.relative_to(one) for path in one.rglob('*.mcap')]
    return bool(names) and all(
        filecmp.cmp(one / name, other / name, shallow=False) for name in names
    )


def scaling(folder: Path, drives: int, frames: int) -> None:
    """Print the table of worker processes."""
    root = make_root(folder / 'root', drives, SyntheticOptions(frames=frames))
    one_cpu = {min(os.sched_getaffinity(0))}
    words = ('--images', 'raw')
    alone = seconds(root, folder / 'one', '--all', '--jobs', '1', *words, cpus=one_cpu)
    pair = seconds(root, folder / 'two', '--all', '--jobs', '2', *words)
    plain = sum(
        seconds(unit.source, folder / 'plain' / f'{unit.name}.mcap', *words, cpus=one_cpu)
        for unit in find_units([root])
    )
    print(f'{drives} drives of {frames} frames, --images raw')
    print(f'  plain command, one CPU  {plain:7.2f} s')
    print(f'  --jobs 1, one CPU       {alone:7.2f} s')
    print(f'  --jobs 2                {pair:7.2f} s, {alone / pair:.2f} x')
    equal = same(folder / 'one', folder / 'two') and same(folder / 'one', folder / 'plain')
    print(f'  bytes {"identical" if equal else "DIFFERENT"}')


def overhead(folder: Path, count: int) -> None:
    """Print the time per tiny unit."""
    root = make_root(folder / 'tiny', count, TINY)
    started = time.perf_counter()
    for unit in find_units([root]):
        run_bag_unit(UnitJob(unit, folder / 'bare' / f'{unit.name}.mcap', {}), lambda *_: None)
    bare = (time.perf_counter() - started) / count
    print(f'{count} units of one tiny frame, ms per unit')
    print(f'  bare conversions        {bare * 1e3:7.2f}')
    for jobs in ('1', '2'):
        words = (root, folder / f'tiny_{jobs}', '--all', '--jobs', jobs)
        first = seconds(*words) / count
        again = seconds(*words) / count
        print(
            f'  --jobs {jobs}                {first * 1e3:7.2f}'
            f' (overhead {(first - bare) * 1e3:.2f}), nothing to do {again * 1e3:.2f}'
        )


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--units', type=int, default=300)
    parser.add_argument('--drives', type=int, default=24)
    parser.add_argument('--frames', type=int, default=20)
    parser.add_argument('--dir', type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.dir) as folder:
        scaling(Path(folder), given.drives, given.frames)
        overhead(Path(folder), given.units)


if __name__ == '__main__':
    main()
