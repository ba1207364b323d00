#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""How fast the Python library reads the points of a drive, against a bare loop of np.fromfile.

    python benchmarks/library.py SRC [--repeat N]

SRC is a KITTI drive, in the page cache after the first round. Both read all scans in turn, in one
process: an open recording against a loop over a list of files, opening and reading against listing
and reading. The import of the package is measured over numpy's, in processes of its own.
"""

from __future__ import annotations

import subprocess
import sys
import time
from statistics import median
from typing import TYPE_CHECKING

import numpy as np
from yardsticks import parse_arguments, report

import kitti_ros2

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

ROUNDS = 15
_IMPORT = """
import time
import numpy
start = time.perf_counter()
import kitti_ros2
kitti_ros2.{}
print(time.perf_counter() - start)
"""


def seconds(read: Callable[[], int]) -> float:
    """Time one round."""
    start = time.perf_counter()
    read()
    return time.perf_counter() - start


def list_scans(src: Path) -> list[Path]:
    """List the scans of a drive."""
    return sorted((src / 'velodyne_points' / 'data').iterdir())


def read_bare(paths: list[Path]) -> int:
    """Read the scans with numpy alone."""
    return sum(len(np.fromfile(path, np.float32).reshape(-1, 4)) for path in paths)


def read_frames(recording: kitti_ros2.Recording) -> int:
    """Read the points of all frames."""
    return sum(len(frame.points) for frame in recording)


def import_seconds(name: str) -> float:
    """Time the import of the package, and of what a name needs, over numpy's."""
    command = [sys.executable, '-c', _IMPORT.format(name)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main() -> None:
    """Measure."""
    arguments = parse_arguments(__doc__)
    paths = list_scans(arguments.src)
    recording = kitti_ros2.open(arguments.src)
    if read_bare(paths) != read_frames(recording):
        raise SystemExit('the library read other points than numpy')
    opened, iterated = [], []
    for _ in range(max(arguments.repeat, ROUNDS)):
        bare = seconds(lambda: read_bare(list_scans(arguments.src)))
        opened.append(bare / seconds(lambda: read_frames(kitti_ros2.open(arguments.src))))
        bare = seconds(lambda: read_bare(paths))
        iterated.append(bare / seconds(lambda: read_frames(recording)))
    note = f'{len(paths)} scans, np.fromfile / library'
    report('points of an open recording', median(iterated), '>= 0.8', note)
    report('open it and read the points', median(opened), '>= 0.8', note)
    for name in ('__name__', 'open'):
        found = median([import_seconds(name) for _ in range(ROUNDS)])
        report(f'import kitti_ros2; kitti_ros2.{name}, ms', found * 1e3, '<= 20', 'over numpy')


if __name__ == '__main__':
    main()
