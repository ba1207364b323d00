#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast kitti-ros2 to-kitti surveys and converts bags of others, beside cat, in the same run.

    python benchmarks/import_speed.py [--gb 1] [--long-gb 10] [--repeat 5] [--dir FOLDER]
        [--storage mcap sqlite3] [--images png jpeg raw] [--cold]

The bags are generated: scans of 65,536 points and images of 1242x375 at 10 Hz, with a camera's
calibration and transforms, written by the libraries mcap and rosbags. Each line is a ratio of
medians; what is compared takes turns, so that a busy moment meets all of it. The files are in the
page cache; --cold takes them out before each turn.

A conversion also writes files. "cat and cp -r" reads the bag, and copies the files of the set: it
reads no less and writes the same bytes to as many files. JPEG and raw images must be encoded as PNG
as well: "bare encoding" decodes and encodes them on all cores, and reads and writes nothing. SQLite
reads a row of a megabyte in pages of 4 KB: "bare query" selects all data, and does no more. MCAP
has checksums: "bare checking" reads blocks of a megabyte and computes theirs.

A survey has a fixed cost of 0.1 to 0.2 s, which counts in a bag of 1 GB in memory, where cat takes
as long, but not in one of 10 GB; --long-gb shows it, with the growth of memory.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import cv2
import numpy as np
from import_bags import GB, VARIANTS, make_picture, write_bag
from yardsticks import COMMAND, fresh, make_parser, report, tree_bytes

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

SURVEY = """
import sys
from pathlib import Path
from kitti_ros2.cli.memory import keep_freed_memory
from kitti_ros2.importer.survey import look
import resource, time
keep_freed_memory()
def cpu():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime
start, used = time.perf_counter(), cpu()
look([Path(sys.argv[1])])
print(time.perf_counter() - start, cpu() - used)
"""

ENCODE = """
import sys, time
from concurrent.futures import ThreadPoolExecutor
import cv2, numpy as np
from kitti_ros2.files.png.encode import encode_png
from kitti_ros2.files.workers import worker_count
cv2.setNumThreads(1)
kind, paths = sys.argv[1], sys.argv[2:]
jpegs = [np.fromfile(path, np.uint8) for path in paths]
images = [cv2.imdecode(jpeg, cv2.IMREAD_COLOR) for jpeg in jpegs]
def encode(place):
    return len(encode_png(cv2.imdecode(jpegs[place], 1) if kind == 'jpeg' else images[place]))
places = [place % len(paths) for place in range(160)]
with ThreadPoolExecutor(worker_count()) as pool:
    start = time.perf_counter()
    list(pool.map(encode, places))
    print((time.perf_counter() - start) / len(places))
"""

CHECK = """
import os, resource, sys, time
from kitti_ros2.files.checksums import crc32
def cpu():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime
start, used = time.perf_counter(), cpu()
file = os.open(sys.argv[1], os.O_RDONLY)
while block := os.read(file, 2**20):
    crc32(block)
print(time.perf_counter() - start, cpu() - used)
"""

QUERY = """
import sqlite3, sys
with sqlite3.connect(f'file:{sys.argv[1]}?immutable=1', uri=True) as connection:
    for row in connection.execute('SELECT id, data FROM messages NOT INDEXED ORDER BY id'):
        pass
"""


@dataclass(frozen=True)
class Cost:
    """Of one run.

    Attributes:
        wall_s: Elapsed.
        cpu_s: User and system time of all threads.
        peak_mb: Most memory; 0 where it was not measured.
    """

    wall_s: float
    cpu_s: float
    peak_mb: float = 0.0


def costs(command: list[str]) -> Cost:
    """Run a command to its end, its output thrown away."""
    with Path(os.devnull).open('wb') as null:
        start = time.perf_counter()
        child = os.posix_spawnp(
            command[0], command, os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, null.fileno(), 1)]
        )
        _, status, usage = os.wait4(child, 0)
        seconds = time.perf_counter() - start
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f'{" ".join(command)} failed')
    return Cost(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1000)


def cost_of(script: str, path: Path) -> Cost:
    """Run a script that prints its times in a process of its own, whose start does not count."""
    words = [sys.executable, '-c', script, str(path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
        out = child.stdout.read() if child.stdout else ''
    if child.returncode:
        raise SystemExit(f'reading {path} failed')
    wall_s, cpu_s = map(float, out.split())
    return Cost(wall_s, cpu_s)


class Bench:
    """The runs on one bag.

    Args:
        bag: What to-kitti is given.
        file: The file of its messages.
        folder: Where to write.
        cold: Whether the file is taken out of the page cache before each run.
    """

    def __init__(self, bag: Path, file: Path, folder: Path, *, cold: bool) -> None:
        self._bag, self.file = bag, file
        self._out, self._copy = folder / 'out', folder / 'copy'
        self._cold = cold
        self.size_bytes = file.stat().st_size

    def run(self, work: Callable[[], Cost]) -> Cost:
        """Run one of the following, prepared."""
        if self._cold:
            file = os.open(self.file, os.O_RDONLY)
            os.fsync(file)
            os.posix_fadvise(file, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(file)
        return work()

    def cat(self) -> Cost:
        """Read the bag."""
        return costs(['cat', str(self.file)])

    def survey(self) -> Cost:
        """Survey it."""
        return cost_of(SURVEY, self._bag)

    def check(self) -> Cost:
        """Read the file and compute the checksums of its blocks."""
        return cost_of(CHECK, self.file)

    def query(self) -> Cost:
        """Select all messages of a sqlite3 bag, start included."""
        return costs([sys.executable, '-c', QUERY, str(self.file)])

    def convert(self) -> Cost:
        """Convert it to an object set, start included; what was there before is gone."""
        fresh(self._out)
        words = ['to-kitti', str(self._bag), str(self._out), '--layout', 'object', '-q']
        return costs([*COMMAND, *words])

    def cat_and_copy(self) -> Cost:
        """Read the bag, and copy the set that was made of it."""
        fresh(self._copy)
        read, copied = self.cat(), costs(['cp', '-r', str(self._out), str(self._copy)])
        return Cost(read.wall_s + copied.wall_s, read.cpu_s + copied.cpu_s)

    def written_bytes(self) -> int:
        """Of the set."""
        return tree_bytes(self._out)

    def image_count(self) -> int:
        """Of the set."""
        return len(list((self._out / 'training/image_2').iterdir()))


def bare_encoding(kind: str, folder: Path) -> float:
    """Seconds an image, decoded where it is JPEG, and encoded as PNG on all cores."""
    rng = np.random.default_rng(1)
    paths = [str(folder / f'{number}.jpeg') for number in range(VARIANTS)]
    for path in paths:
        if not Path(path).exists():
            cv2.imwrite(path, make_picture(rng))
    words = [sys.executable, '-c', ENCODE, kind, *paths]
    return float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def ratio(name: str, of: list[Cost], to: list[Cost], size_bytes: int, bound: str = '') -> None:
    """Report the speed of one work as a part of another's, by wall and by CPU time."""
    wall_s, base_s = median(c.wall_s for c in of), median(c.wall_s for c in to)
    cpu = median(c.cpu_s for c in to) / median(c.cpu_s for c in of)
    rates = f'{size_bytes / wall_s / 1e6:.0f} and {size_bytes / base_s / 1e6:.0f} MB/s'
    report(name, base_s / wall_s, bound, f'{rates}; by CPU time {cpu:.2f}')


def measure(bench: Bench, kind: str, repeat: int, folder: Path) -> float:
    """Report on a bag; return the peak memory of the conversion in MB."""
    works = [bench.cat, bench.survey, bench.convert, bench.cat_and_copy]
    if bench.file.suffix == '.db3':
        works.append(bench.query)
    else:
        works.append(bench.check)
    bench.cat()
    bench.convert()  # the first fills the page cache, for all alike
    runs: dict[str, list[Cost]] = {work.__name__: [] for work in works}
    encodes = []
    for _ in range(repeat):
        for work in works:
            runs[work.__name__].append(bench.run(work))
        if kind != 'png':
            encodes.append(bare_encoding(kind, folder))
    size_bytes, cat, converted = bench.size_bytes, runs['cat'], runs['convert']
    ratio('  survey / cat', runs['survey'], cat, size_bytes, '>= 0.6')
    if 'query' in runs:
        ratio('  bare query / cat', runs['query'], cat, size_bytes)
        ratio('  survey / bare query', runs['survey'], runs['query'], size_bytes, '>= 0.6')
    else:
        ratio('  bare checking / cat', runs['check'], cat, size_bytes)
        ratio('  survey / bare checking', runs['survey'], runs['check'], size_bytes, '>= 0.6')
    ratio('  conversion, whole process / cat', converted, cat, size_bytes)
    copied = runs['cat_and_copy']
    ratio('  cat and cp -r / cat', copied, cat, size_bytes)
    bound = '>= 0.6' if kind == 'png' else ''
    ratio('  conversion / cat and cp -r', converted, copied, size_bytes, bound)
    if encodes:
        count, each_s = bench.image_count(), median(encodes)
        wall_s = median(cost.wall_s for cost in converted)
        ideal_s = each_s * count + median(cost.wall_s for cost in copied)
        note = f'{count / wall_s:.0f} images/s; encoding alone {1 / each_s:.0f}'
        report('  the same / these and bare encoding', ideal_s / wall_s, '>= 0.6', note)
    peak_mb = max(cost.peak_mb for cost in converted)
    note = f'bag {size_bytes / 1e6:.0f} MB, set {bench.written_bytes() / 1e6:.0f} MB'
    report('  peak memory, MB', peak_mb, '<= 400', note)
    return peak_mb


def measure_long(bench: Bench, peak_mb: float) -> None:
    """Report on a long bag, by one run each, beside the peak memory of a short one."""
    cat, surveyed = bench.run(bench.cat), bench.run(bench.survey)
    cats, surveys = [cat, bench.run(bench.cat)], [surveyed, bench.run(bench.survey)]
    converted = bench.run(bench.convert)
    size_bytes = bench.size_bytes
    ratio('  long bag: survey / cat', surveys, cats, size_bytes, '>= 0.6')
    ratio('  long bag: conversion / cat', [converted], cats, size_bytes)
    note = f'{converted.peak_mb:.0f} MB for {size_bytes / GB:.1f} GB'
    report(
        '  long bag: peak memory / that of the short', converted.peak_mb / peak_mb, '<= 1.1', note
    )


def parse() -> argparse.Namespace:
    """Parse the command line."""
    parser = make_parser(__doc__)
    parser.add_argument('--gb', type=float, default=1.0, help='size of a bag')
    parser.add_argument('--long-gb', type=float, default=0.0, help='of one for growth of memory')
    parser.add_argument('--repeat', type=int, default=5)
    parser.add_argument('--dir', type=Path, help='where to write')
    parser.add_argument('--storage', nargs='+', default=['mcap', 'sqlite3'])
    parser.add_argument('--images', nargs='+', default=['png', 'jpeg', 'raw'])
    parser.add_argument('--cold', action='store_true', help='from the disk, not the page cache')
    return parser.parse_args()


def make_bench(args: argparse.Namespace, storage: str, kind: str, gb: float, folder: Path) -> Bench:
    """Write a bag, and return its runs."""
    bag = folder / (f'{kind}.mcap' if storage == 'mcap' else kind)
    file = write_bag(bag, storage, kind, round(gb * GB))
    return Bench(bag, file, folder, cold=args.cold)


def main() -> None:
    """Measure."""
    args = parse()
    for storage in args.storage:
        for kind in args.images:
            print(f'{storage}, {kind} images, {"from the disk" if args.cold else "in memory"}')
            with tempfile.TemporaryDirectory(dir=args.dir) as name:
                bench = make_bench(args, storage, kind, args.gb, Path(name))
                peak_mb = measure(bench, kind, args.repeat, Path(name))
            if not args.long_gb:
                continue
            with tempfile.TemporaryDirectory(dir=args.dir) as name:
                measure_long(make_bench(args, storage, kind, args.long_gb, Path(name)), peak_mb)


if __name__ == '__main__':
    main()
