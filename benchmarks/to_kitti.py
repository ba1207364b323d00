#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast and how small kitti-ros2 to-kitti is, beside yardsticks timed in the same run.

    python benchmarks/to_kitti.py SRC [--long LONGER_SRC] [--repeat N] [--dir FOLDER]

SRC is a KITTI drive, which becomes bags first. Each line is a ratio of medians; what is compared
takes turns, so that a busy moment meets all of them.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.own_bags.restore import restore
from kitti_ros2.own_bags.source_files import find_source_files

from yardsticks import (  # isort: skip
    COMMAND,
    Drive,
    Run,
    fresh,
    measure_memory,
    parse_arguments,
    process,
    report,
    timed,
)

ENCODE = """
import sys, time, zlib, cv2, numpy as np
kind, *paths = sys.argv[1:]
if kind == 'fpng_py':
    import fpng_py
    encode = lambda p: fpng_py.fpng_encode_image_to_memory(p.tobytes(), p.shape[1], p.shape[0], 3)
elif kind == 'opencv':
    encode = lambda p: cv2.imencode('.png', p, [cv2.IMWRITE_PNG_COMPRESSION, 1])
elif kind == 'zlib':
    try:
        from zlib_ng import zlib_ng as library
    except ImportError:
        library = zlib
    def encode(rows):
        packer = library.compressobj(1, zlib.DEFLATED, 15, 8, zlib.Z_HUFFMAN_ONLY)
        packer.compress(rows), packer.flush()
else:
    from kitti_ros2.files.image_files import encode_png as encode
def differences(pixels):
    step, wide = pixels[0, 0].size, pixels.reshape(len(pixels), -1)
    rows = np.ones((len(wide), 1 + wide.shape[1]), np.uint8)
    rows[:, 1:] = wide
    rows[:, 1 + step:] -= wide[:, :-step]
    return rows.tobytes()
images = [cv2.imread(path, cv2.IMREAD_UNCHANGED) for path in paths]
images = [i if i.ndim == 3 or kind != 'fpng_py' else np.repeat(i[..., None], 3, 2) for i in images]
images = [differences(i) for i in images] if kind == 'zlib' else images
started, cpu = time.perf_counter(), time.process_time()
for pixels in images:
    encode(pixels)
took = time.perf_counter() - started, time.process_time() - cpu
print(*(seconds / len(images) for seconds in took))
"""

ENCODE_AND_WRITE = """
import os, sys, time, cv2
from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.files.image_files import encode_png
from kitti_ros2.files.local_files import write_uncached
try:
    from fpng_py import fpng_encode_image_to_memory as fpng
except ImportError:
    fpng = None
keep_freed_memory()
out, *paths = sys.argv[1:]
images = [cv2.imread(path, cv2.IMREAD_UNCHANGED) for path in paths if path.endswith('.png')]
scans = [open(path, 'rb').read() for path in paths if not path.endswith('.png')]
def write(name, data):
    file = os.open(os.path.join(out, name), os.O_WRONLY | os.O_CREAT)
    done = 0
    while done < len(data):
        done += write_uncached(file, [memoryview(data)[done:]], done)
    os.close(file)
def encode(pixels):
    if fpng is None or pixels.ndim == 2:
        return encode_png(pixels)
    return fpng(pixels.tobytes(), pixels.shape[1], pixels.shape[0], 3)
print('ready', flush=True)
sys.stdin.readline()
started = time.perf_counter()
for number, pixels in enumerate(images):
    write(f'{os.getpid()}_{number}.png', encode(pixels))
for number, data in enumerate(scans):
    write(f'{os.getpid()}_{number}.bin', data)
print(time.perf_counter() - started)
"""


class Bench(Drive):
    """The work that is timed, on one drive."""

    def bag(self, images: str, src: Path) -> Path:
        """A bag of a drive, made once."""
        path = self.folder / f'{"" if src == self.src else "long_"}{images}.mcap'
        if not path.exists():
            words = [*COMMAND, 'to-bag', str(src), str(path), '-q', '--images', images]
            subprocess.run(words, check=True)
        return path

    def restore(self, bag: Path) -> Run:
        """The conversion alone, in this process."""
        out = self.folder / 'out'

        def work() -> None:
            with OpenBag(bag) as opened:
                source_files = find_source_files(opened)
                if source_files is None:
                    raise SystemExit(f'{bag} is none of to-bag')
                restore([(opened, source_files)], out)

        return timed(out, work)

    def back(self, bag: Path) -> tuple[Run, float]:
        """The whole command, start included; also its peak memory in MB."""
        out = self.folder / 'out'
        return process(out, 'to-kitti', str(bag), str(out), '-q')

    def peak_mb(self, src: Path, images: str) -> float:
        """Peak memory of the whole command; the bag of a longer drive is removed."""
        bag = self.bag(images, src)
        peak = self.back(bag)[1]
        if src != self.src:
            bag.unlink()
        return peak

    def encode(self, kind: str, cores: int = 1) -> tuple[float, float]:
        """Time an image by a bare loop of one encoder takes, a process for each core.

        Returns:
            Seconds, and CPU seconds.
        """
        some = self.pngs[:: max(1, len(self.pngs) // 80)]
        runs = [
            subprocess.Popen(
                [sys.executable, '-c', ENCODE, kind, *some[core::cores]],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            for core in range(cores)
        ]
        took = [[float(word) for word in run.communicate()[0].split()] for run in runs]
        if not all(took):
            return float('inf'), float('inf')
        return max(seconds for seconds, _ in took) / cores, sum(cpu for _, cpu in took) / cores

    def encode_and_write(self) -> float:
        """Seconds in which all cores encode the images and write them and the scans, no more.

        The fastest encoders in processes of their own, and nothing read: no program is faster.
        """
        out = fresh(self.folder / 'out')
        out.mkdir()
        scans = sorted(str(path) for path in self.recording.root.rglob('*.bin'))
        files = [*self.pngs, *scans]
        cores = os.cpu_count() or 1
        runs = [
            subprocess.Popen(
                [sys.executable, '-c', ENCODE_AND_WRITE, str(out), *files[core::cores]],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for core in range(cores)
        ]
        for run in runs:
            if run.stdout is None or run.stdout.readline() != 'ready\n':
                raise SystemExit('the yardstick of encoding and writing failed')
        seconds = [float(run.communicate(timeout=600)[0]) for run in _started(runs)]
        fresh(out)
        return max(seconds)


def _started(runs: list[subprocess.Popen[str]]) -> list[subprocess.Popen[str]]:
    """The same, all of them told to begin at once."""
    for run in runs:
        if run.stdin is not None:
            run.stdin.write('\n')
            run.stdin.flush()
    return runs


def measure_pass_through(bench: Bench, repeat: int) -> None:
    """Against cp -r."""
    bag = bench.bag('compressed', bench.src)
    copies, alone, backs = [], [], []
    for _ in range(repeat):
        copies.append(bench.copy().rate)
        alone.append(bench.restore(bag).rate)
        backs.append(bench.back(bag)[0].rate)
    copy_rate = median(copies)
    note = f'cp -r {copy_rate / 1e6:.0f} MB/s'
    report('PNG pass-through / cp -r', median(alone) / copy_rate, '>= 0.6', note)
    note = f'{median(backs) / 1e6:.0f} MB/s'
    report('the same, whole process', median(backs) / copy_rate, '', note)


def measure_raw(bench: Bench, repeat: int) -> None:
    """Against encoding alone on every core, by the fastest encoder at hand, and by bare zlib.

    Images are written in KITTI's form, whose bytes are those of zlib of the differences in rows.
    """
    cores = os.cpu_count() or 1
    bag = bench.bag('raw', bench.src)
    encodes: dict[str, list[float]] = {kind: [] for kind in ('fpng_py', 'opencv', 'kitti_ros2')}
    zlib: list[tuple[float, float]] = []
    cpu = []
    alone, backs, bounds = [], [], []
    for _ in range(repeat):
        for kind, seconds in encodes.items():
            seconds.append(bench.encode(kind)[0])
        zlib.append(bench.encode('zlib', cores))
        bounds.append(bench.encode_and_write())
        before = time.process_time()
        alone.append(bench.restore(bag).seconds)
        cpu.append(time.process_time() - before)
        backs.append(bench.back(bag)[0].seconds)
    for kind, seconds in encodes.items():
        print(f'  {kind}: {median(seconds) * 1000:.1f} ms an image on one core')
    bare, bare_cpu = (median(each) * len(bench.pngs) for each in zip(*zlib, strict=True))
    note = f"KITTI's form; of CPU time {bare_cpu / median(cpu):.2f}"
    report('raw images / bare zlib on all cores', bare / median(alone), '>= 0.8', note)
    fastest = min(median(seconds) for seconds in encodes.values())
    ideal = fastest * len(bench.pngs) / cores
    note = f'{len(bench.pngs) / median(alone):.0f} images/s, cores {cores}'
    report('raw images / bare encoding on all cores', ideal / median(alone), '', note)
    bound = median(bounds)
    note = f'{len(bench.pngs) / bound:.0f} images/s'
    ratio = bound / median(alone)
    report('raw images / encoding and writing on all cores', ratio, '>= 0.5', note)
    report('encoding and writing / bare encoding', ideal / bound, '', 'the most that can be had')
    note = f'{len(bench.pngs) / median(backs):.0f} images/s'
    report('the same, whole process', ideal / median(backs), '', note)


def main() -> None:
    """Run all measures."""
    args = parse_arguments(__doc__)
    with tempfile.TemporaryDirectory(dir=args.dir or args.src.resolve().parent.parent) as folder:
        bench = Bench(args.src, Path(folder))
        keep_freed_memory()  # as the command does
        bench.copy()  # warms the page cache, for all alike
        measure_pass_through(bench, args.repeat)
        measure_raw(bench, max(3, args.repeat // 2))
        measure_memory(args.src, args.long, '<= 400', bench.peak_mb)


if __name__ == '__main__':
    main()
