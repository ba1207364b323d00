#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast and how small kitti-ros2 to-bag is, beside yardsticks timed in the same run.

    python benchmarks/to_bag.py SRC [--long LONGER_SRC] [--repeat N] [--dir FOLDER]

SRC is a KITTI drive, of 480 frames for the comparison with cp -r. Each line is a ratio of medians,
that with cp -r the median of the pairs' ratios; what is compared takes turns, so that a busy moment
meets all of them. LONGER_SRC, a longer drive of the same kind, shows whether memory grows.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import SelectionOptions
from kitti_ros2.own_bags.to_bag import ExportOptions, convert

from yardsticks import (  # isort: skip
    COMMAND,
    Drive,
    Run,
    measure_memory,
    parse_arguments,
    process,
    report,
    seconds,
    timed,
)

DECODE = """
import sys, time, cv2, numpy as np
started = time.perf_counter()
for path in sys.argv[1:]:
    cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
print(time.perf_counter() - started)
"""


class Bench(Drive):
    """The work that is timed, on one drive, each time into a fresh output."""

    def convert(self, images: Images) -> Run:
        """The conversion alone, in this process."""
        out, messages = self.folder / 'out.mcap', MessageOptions(images=images)
        options = ExportOptions(messages, SelectionOptions(), BagOptions())

        def work() -> None:
            convert(open_recording(self.src), out, options)

        return timed(out, work)

    def process(self, src: Path, images: str) -> tuple[Run, float]:
        """The whole command, to the disk, start included; also its peak memory in MB."""
        out = self.folder / 'out.mcap'
        words = ('to-bag', str(src), str(out), '-q', '--images', images)
        return process(out, *words, to_disk=True)

    def decode(self) -> float:
        """Seconds of a bare loop over the drive's PNGs, one core, in a process of its own."""
        words = [sys.executable, '-c', DECODE, *self.pngs]
        return float(subprocess.run(words, check=True, capture_output=True).stdout)


def measure_pass_through(bench: Bench, repeat: int) -> None:
    """The whole command against cp -r, both until everything is on the disk."""
    copies, wholes = [], []
    for _ in range(repeat):
        copies.append(bench.copy(to_disk=True).rate)
        wholes.append(bench.process(bench.src, 'compressed')[0].rate)
    ratios = [whole / copied for whole, copied in zip(wholes, copies, strict=True)]
    note = f'{median(wholes) / 1e6:.0f} MB/s; cp -r {median(copies) / 1e6:.0f} MB/s'
    report('PNG pass-through / cp -r, with sync', median(ratios), '>= 0.8', note)


def measure_raw(bench: Bench, repeat: int) -> None:
    """Against decoding alone on every core."""
    cores = os.cpu_count() or 1
    keep_freed_memory()  # as the command does
    decodes, raws = [], []
    for _ in range(repeat):
        decodes.append(bench.decode())
        raws.append(bench.convert(Images.RAW).seconds)
    ideal = median(decodes) / cores
    frames = len(bench.recording.streams[max(bench.recording.streams, key=lambda s: s.camera or 0)])
    note = f'{frames / median(raws):.0f} frames/s, cores {cores}'
    report('--images raw / bare decoding on all cores', ideal / median(raws), '>= 0.8', note)


def measure_help(repeat: int) -> None:
    """Against importing numpy."""

    def run(*words: str) -> float:
        return seconds(lambda: subprocess.run(words, check=True, stdout=subprocess.DEVNULL))

    helps, numpys = [], []
    for _ in range(repeat):
        numpys.append(run(sys.executable, '-c', 'import numpy'))
        helps.append(run(*COMMAND, '--help'))
    note = f'{median(helps) * 1000:.0f} ms'
    report('kitti-ros2 --help / import numpy', median(helps) / median(numpys), '<= 3', note)


def main() -> None:
    """Run all measures."""
    args = parse_arguments(__doc__)
    with tempfile.TemporaryDirectory(dir=args.dir or args.src.resolve().parent.parent) as folder:
        bench = Bench(args.src, Path(folder))
        bench.copy(to_disk=True)  # warms the page cache, for all alike
        measure_pass_through(bench, args.repeat)
        measure_raw(bench, max(3, args.repeat // 2))
        measure_memory(args.src, args.long, '<= 300', lambda *what: bench.process(*what)[1])
        measure_help(args.repeat)


if __name__ == '__main__':
    main()
