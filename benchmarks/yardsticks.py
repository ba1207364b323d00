# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks of the conversions share: timed runs, cp -r, the command as a process."""

from __future__ import annotations

import argparse
import itertools
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_ASIDE = itertools.count()
COMMAND = ('-m', 'kitti_ros2')


@dataclass(frozen=True)
class Run:
    """One timed run: seconds, and the bytes it wrote where that matters."""

    seconds: float
    size_bytes: int = 0

    @property
    def rate(self) -> float:
        """Bytes per second."""
        return self.size_bytes / self.seconds


def parse_arguments(description: str | None) -> argparse.Namespace:
    """The command line of a benchmark: src, long, repeat and dir."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument('src', type=Path)
    parser.add_argument('--long', type=Path, help='a longer drive, for the growth of memory')
    parser.add_argument('--repeat', type=int, default=9)
    parser.add_argument('--dir', type=Path, help='where to write; on the disk of SRC by default')
    return parser.parse_args()


def timed(work: Callable[[], int], *, to_disk: bool = False) -> Run:
    """Time work, which returns the bytes it wrote; to_disk counts until they are on the disk."""
    os.sync()  # what an earlier run left to be written is not this one's burden
    started = time.perf_counter()
    size_bytes = work()
    if to_disk:
        os.sync()
    return Run(time.perf_counter() - started, size_bytes)


def tree_bytes(folder: Path) -> int:
    """Size of all files below a folder, or of a file."""
    if folder.is_file():
        return folder.stat().st_size
    return sum(path.stat().st_size for path in folder.rglob('*') if path.is_file())


def fresh(path: Path) -> Path:
    """A path with nothing at it; a folder there is moved aside, its files emptied.

    They are not removed: ext4 steps around the inodes of files that were just removed one by one,
    which would be a fifth of the time of whatever writes the next folder.
    """
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
        return path
    aside = path.rename(path.with_name(f'{path.name}.{next(_ASIDE)}'))
    for folder, _, names in os.walk(aside):
        for file in (Path(folder, name) for name in names):
            if not file.is_symlink():  # what a copied link leads to is the user's
                os.truncate(file, 0)
    return path


def copy(source: Path, out: Path, *, to_disk: bool = False) -> Run:
    """Copy a folder by cp -r."""
    fresh(out)
    command = ['cp', '-r', str(source), str(out)]
    run = timed(lambda: subprocess.run(command, check=True).returncode, to_disk=to_disk)
    size_bytes = tree_bytes(out)
    fresh(out)
    return Run(run.seconds, size_bytes)


def process(out: Path, *words: str, to_disk: bool = False) -> tuple[Run, float]:
    """A command of kitti-ros2 that makes out, start included; also its peak memory in MB."""
    fresh(out)
    command = [sys.executable, *COMMAND, *words]
    peak = 0.0

    def work() -> int:
        nonlocal peak
        _, status, usage = os.wait4(os.posix_spawn(command[0], command, os.environ), 0)
        if os.waitstatus_to_exitcode(status):
            raise SystemExit(f'{" ".join(words)} failed')
        peak = usage.ru_maxrss / 1000
        return 0

    run = timed(work, to_disk=to_disk)
    size_bytes = tree_bytes(out)
    fresh(out)
    return Run(run.seconds, size_bytes), peak


def median(values: list[float]) -> float:
    """The median."""
    return statistics.median(values)


def report(name: str, value: float, bound: str, note: str) -> None:
    """One line."""
    print(f'{name:<46}{value:8.2f}   {bound:<10} {note}', flush=True)
