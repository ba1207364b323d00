# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The runs of import_speed.py: to-kitti on a bag, and what it is compared with, each timed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from import_bags import VARIANTS, make_picture, write_bag
from yardsticks import COMMAND, fresh, tree_bytes

if TYPE_CHECKING:
    from collections.abc import Callable

_TIMES = """
import resource, time
def cpu():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime
"""
"""The begin of each script for cost_of."""

SURVEY = f"""{_TIMES}
import sys
from pathlib import Path
from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.importer.survey import survey_bags
keep_freed_memory()
start, used = time.perf_counter(), cpu()
survey_bags([Path(sys.argv[1])])
print(time.perf_counter() - start, cpu() - used)
"""

ENCODE = """
import sys, time
from concurrent.futures import ThreadPoolExecutor
import cv2, numpy as np
from kitti_ros2.files.image_files import encode_png
from kitti_ros2.files.threads import worker_count
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

CHECK = f"""{_TIMES}
import os, sys
from kitti_ros2.files.local_files import crc32
start, used = time.perf_counter(), cpu()
file = os.open(sys.argv[1], os.O_RDONLY)
while block := os.read(file, 2**20):
    crc32(block)
print(time.perf_counter() - start, cpu() - used)
"""

CHECK_AHEAD = f"""{_TIMES}
import os, sys
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from kitti_ros2.files.local_files import crc32
from kitti_ros2.files.processes import keep_freed_memory
from kitti_ros2.files.threads import worker_count
keep_freed_memory()
file = os.open(sys.argv[1], os.O_RDONLY)
def check(position):
    block = os.pread(file, 2**21, position)
    crc32(block)
    return block
start, used = time.perf_counter(), cpu()
with ThreadPoolExecutor(worker_count()) as pool:
    ahead = deque()
    for position in range(0, os.fstat(file).st_size, 2**21):
        ahead.append(pool.submit(check, position))
        if len(ahead) > 4:
            ahead.popleft().result()
    while ahead:
        ahead.popleft().result()
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
    environment = {**os.environ, 'OPENBLAS_NUM_THREADS': '1'}  # as the command line sets it
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment) as child:
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
        self._short = folder / 'short.mcap'
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

    def check_and_begin(self) -> Cost:
        """Do the same on all cores, in blocks as large as a chunk, and survey a bag of 20 MB."""
        if not self._short.exists():
            write_bag(self._short, 'mcap', 'png', 2 * 10**7)
        checked, begun = cost_of(CHECK_AHEAD, self.file), cost_of(SURVEY, self._short)
        return Cost(checked.wall_s + begun.wall_s, checked.cpu_s + begun.cpu_s)

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
