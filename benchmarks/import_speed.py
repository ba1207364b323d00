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
has checksums: "bare checking" reads blocks of a megabyte and computes theirs; on all cores, threads
do so ahead of the main one, which does nothing, and "start" is the survey of a bag of 20 MB.

A survey has a fixed cost of 0.05 to 0.1 s, which counts in a bag of 1 GB in memory, where cat takes
as long, but not in one of 10 GB; --long-gb shows it, with the growth of memory.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from import_bags import GB, write_bag
from import_runs import Bench, Cost, bare_encoding
from yardsticks import make_parser, report

if TYPE_CHECKING:
    import argparse


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
        works += [bench.check, bench.check_and_begin]
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
        limit = runs['check_and_begin']
        ratio('  bare checking on all cores and start / cat', limit, cat, size_bytes)
        ratio('  survey / these', runs['survey'], limit, size_bytes, '>= 0.6')
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
    converted, copied = bench.run(bench.convert), bench.run(bench.cat_and_copy)
    size_bytes = bench.size_bytes
    ratio('  long bag: survey / cat', surveys, cats, size_bytes, '>= 0.6')
    ratio('  long bag: conversion / cat', [converted], cats, size_bytes)
    ratio('  long bag: conversion / cat and cp -r', [converted], [copied], size_bytes)
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
