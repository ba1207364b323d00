#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How kitti-ros2 to-bag --all scales: worker processes, frames, units, and SIGKILL.

    python benchmarks/whole_collections.py [--parts PART ...] [--drives N] [--frames N]
        [--units N] [--kills N] [--dir FOLDER]

workers: synthetic drives with --images raw: --jobs 1 on one CPU beside --jobs 2, and beside two
independent --jobs 1 of half of the drives each, which is what the machine can do; then a local
Dask cluster of two worker processes, its start included. Bytes are equal.
FOLDER is best on a disk. In memory (tmpfs) each page that is written is a new one, which a virtual
machine gets from its host at 2 ms a MB, and two processes that ask wait for each other.

growth: one drive of 10 to 1000 frames, and 10 to 1000 units of one tiny frame. The cost is CPU
time, which other programs on the machine change less than elapsed time. It is linear if all lie
near one straight line: the start of a run, and a cost for each frame or unit.

many: N units of one tiny frame: time and CPU time of a unit beside those of bare conversions in one
process, peak memory, a second run, status; then a run that is killed N times and continued:
the manifest is whole, agrees with the outputs, and their bytes are those of the run before.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import sqlite3
import time
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from kitti_ros2.batch.job_functions import run_bag_job
from kitti_ros2.batch.jobs import find_jobs
from kitti_ros2.batch.manifest import DONE, MANIFEST, read_manifest
from kitti_ros2.batch.pool import JobTask
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from child_runs import Usage, best, kill_when, run_together, to_bag  # isort: skip
from yardsticks import COMMAND, make_parser, parse_in_folder  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

TINY = SyntheticOptions(frames=1, image_size=(62, 20), lidar_columns=20)
GROWING = (10, 30, 100, 300, 1000)
REPEATS = 3


def make_root(folder: Path, drives: int, options: SyntheticOptions) -> Path:
    """Write so many copies of a synthetic drive; the copies are hard links."""
    drive = write_synthetic(folder, Layout.RAW, options)
    for number in range(2, drives + 1):
        copy = drive.with_name(drive.name.replace('0001', f'{number:04d}'))
        shutil.copytree(drive, copy, copy_function=os.link)
    return folder


def same(one: Path, other: Path) -> bool:
    """Whether two folders hold the same bags, and no partial ones."""
    found = [
        {path.relative_to(folder) for path in folder.rglob('*.mcap*')} for folder in (one, other)
    ]
    return (
        bool(found[0])
        and found[0] == found[1]
        and all(filecmp.cmp(one / name, other / name, shallow=False) for name in found[0])
    )


def row(name: str, usage: Usage, note: str = '') -> None:
    """Print a row of a table."""
    memory = f'{usage.memory / 1e6:.0f} MB'
    print(f'  {name:<28} {usage.wall:8.2f} s {usage.cpu:8.2f} s CPU {memory:>8} {note}'.rstrip())


def workers(folder: Path, drives: int, frames: int) -> None:
    """Print the table of worker processes."""
    root = make_root(folder / 'root', drives, SyntheticOptions(frames=frames))
    cpus = sorted(os.sched_getaffinity(0))
    found = [job.source for job in find_jobs([root])]
    halves = [folder / 'first.txt', folder / 'second.txt']
    for path, part in zip(halves, (found[::2], found[1::2]), strict=True):
        path.write_text(''.join(f'{each}\n' for each in part), 'utf-8')
    words = ('--all', '--images', 'raw')
    alone = run_together([to_bag(root, folder / 'one', *words, '--jobs', '1')], [{cpus[0]}])
    pair = run_together([to_bag(root, folder / 'two', *words, '--jobs', '2')])
    apart = run_together(
        [to_bag(half, folder / half.stem, *words, '--jobs', '1') for half in halves],
        [{cpu} for cpu in (cpus * 2)[:2]],
    )
    cluster = run_together(
        [to_bag(root, folder / 'dask', *words, '--scheduler', 'local', '--jobs', '2')]
    )
    print(f'{drives} drives of {frames} frames, --images raw')
    row('--jobs 1, one CPU', alone)
    row('--jobs 2', pair, f'{alone.wall / pair.wall:.2f} x')
    row('two runs of half the drives', apart, f'{alone.wall / apart.wall:.2f} x, the limit here')
    row('--scheduler local --jobs 2', cluster, f'{alone.wall / cluster.wall:.2f} x')
    equal = all(same(folder / 'one', folder / other) for other in ('two', 'dask'))
    print(f'  bytes {"identical" if equal else "DIFFERENT"}')


def growth(folder: Path) -> None:
    """Print the cost of growing numbers of frames and of units, beside a straight line."""
    for kind in ('frames', 'units'):
        costs = []
        print(f'CPU time of growing numbers of {kind}')
        for count in GROWING:
            if kind == 'frames':
                options = SyntheticOptions(frames=count, image_size=(310, 94), lidar_columns=200)
            else:
                options = TINY
            drives = count if kind == 'units' else 1
            root, out = make_root(folder / f'{kind}_{count}', drives, options), folder / 'grown'
            clear = partial(shutil.rmtree, out, ignore_errors=True)
            usage = best(REPEATS, to_bag(root, out, '--all', '--jobs', '2'), clear)
            costs.append(usage.cpu)
            row(f'{count} {kind}', usage)
        _print_line(kind, costs)


def _print_line(kind: str, costs: list[float]) -> None:
    """Print the line whose greatest deviation from the costs, as a part of them, is least."""
    scale = 1 / np.array(costs)
    basis = np.stack((np.ones(len(costs)), np.array(GROWING))).T * scale[:, np.newaxis]
    weights = np.ones(len(costs))
    for _ in range(2000):  # Lawson's algorithm
        root = np.sqrt(weights)
        (start, each), *_ = np.linalg.lstsq(basis * root[:, np.newaxis], root, rcond=None)
        off = basis @ (start, each) - 1
        weights *= np.abs(off)
        weights /= weights.sum()
    print(
        f'  {start:.2f} s and {each * 1e3:.2f} ms for each of {kind}: all within'
        f' {np.abs(off).max():.0%}  <= 10%'
    )


def many(folder: Path, count: int, kills: int) -> None:
    """Print the cost of a tiny unit, and what kills leave."""
    root, out = make_root(folder / 'tiny', count, TINY), folder / 'many'
    bare = _bare(folder, root, min(count, 1000))
    print(f'{count} units of one tiny frame; {bare * 1e3:.2f} ms CPU for a bare conversion')
    for jobs in ('1', '2'):
        shutil.rmtree(out, ignore_errors=True)
        command = to_bag(root, out, '--all', '--jobs', jobs)
        first = run_together([command])
        over = (first.cpu / count - bare) * 1e3
        row(f'--jobs {jobs}', first, f'{over:.2f} ms CPU more than bare for a unit')
        row(f'--jobs {jobs} again', run_together([command]), 'nothing to do')
    row('status', run_together([[*COMMAND, 'status', str(out), '-q']]))
    if kills:
        _killed(root, out, folder / 'killed', count, kills)


def _bare(folder: Path, root: Path, most: int) -> float:
    started = time.process_time()
    for job in find_jobs([root])[:most]:
        run_bag_job(JobTask(job, folder / 'bare' / f'{job.name}.mcap', {}), lambda *_: None)
    return (time.process_time() - started) / most


def _killed(root: Path, whole: Path, out: Path, count: int, kills: int) -> None:
    command = to_bag(root, out, '--all', '--jobs', '2')
    wrong = 0
    for number in range(1, kills + 1):
        enough = count * number // (kills + 1)
        killed = kill_when(command, lambda enough=enough: len(_bags(out)) >= enough)  # type: ignore[misc]
        wrong += not killed or not _sound(out)
    last = run_together([command])
    equal = same(whole, out) and _sound(out)
    left = [path for path in out.rglob('.*') if path.name.endswith('.partial')]
    row('the run after the last kill', last)
    print(
        f'  {kills} kills, {wrong} with an unsound manifest; outputs'
        f' {"identical" if equal else "DIFFERENT"}, {len(left)} partial ones left'
    )


def _bags(out: Path) -> list[str]:
    """Return the bags, by the names of their units."""
    folders = [path for path in out.iterdir() if path.is_dir()] if out.is_dir() else []
    return [
        f'{folder.name}/{path.stem}'
        for folder in folders
        for path in folder.iterdir()
        if path.suffix == '.mcap' and path.name[0] != '.'
    ]


def _sound(out: Path) -> bool:
    """Whether the manifest is whole, and each unit that it calls done has its output."""
    with closing(sqlite3.connect(out / MANIFEST)) as database:
        (verdict,) = database.execute('PRAGMA integrity_check').fetchone()
    done = {each.name for each in read_manifest(out)[0] if each.state == DONE}
    return verdict == 'ok' and done <= set(_bags(out))


def main() -> None:
    """Print the tables."""
    parser = make_parser(None)
    parser.add_argument('--parts', nargs='+', default=['workers', 'growth', 'many'])
    parser.add_argument('--units', type=int, default=300)
    parser.add_argument('--kills', type=int, default=20)
    parser.add_argument('--drives', type=int, default=24)
    parser.add_argument('--frames', type=int, default=20)
    with parse_in_folder(parser) as (given, folder):
        if 'workers' in given.parts:
            workers(folder / 'workers', given.drives, given.frames)
        if 'growth' in given.parts:
            growth(folder / 'growth')
        if 'many' in given.parts:
            many(folder / 'many', given.units, given.kills)


if __name__ == '__main__':
    main()
