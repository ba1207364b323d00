# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks share: arguments, timed runs, cp -r, the command as a process, a report."""

from __future__ import annotations

import argparse
import itertools
import os
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from kitti_ros2.kitti.opening import open_recording

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_ASIDE = itertools.count()
COMMAND = (sys.executable, '-m', 'kitti_ros2')


@dataclass(frozen=True)
class Run:
    """One timed run: seconds, and the bytes it wrote."""

    seconds: float
    size_bytes: int

    @property
    def rate(self) -> float:
        """Bytes per second."""
        return self.size_bytes / self.seconds


class Drive:
    """A drive, and the folder for what is made of it."""

    def __init__(self, src: Path, folder: Path) -> None:
        self.src = src
        self.folder = folder
        self.recording = open_recording(src)
        self.pngs = sorted(
            str(path)
            for path in self.recording.root.rglob('*.png')
            if self.recording.name in path.parts
        )

    def copy(self, *, to_disk: bool = False) -> Run:
        """Copy the drive with its calibration, by cp -r."""
        out = self.folder / 'copy'
        command = ['cp', '-r', str(self.recording.root), str(out)]
        return timed(out, lambda: subprocess.run(command, check=True), to_disk=to_disk)


def make_parser(description: str | None) -> argparse.ArgumentParser:
    """The command line of a benchmark, without arguments."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawTextHelpFormatter
    )


def parse_arguments(description: str | None) -> argparse.Namespace:
    """The command line of a benchmark: src, long, repeat and dir."""
    parser = make_parser(description)
    parser.add_argument('src', type=Path)
    parser.add_argument('--long', type=Path, help='a longer drive, for the growth of memory')
    parser.add_argument('--repeat', type=int, default=9)
    parser.add_argument('--dir', type=Path, help='where to write; on the disk of SRC by default')
    return parser.parse_args()


@contextmanager
def parse_in_folder(
    parser: argparse.ArgumentParser, meaning: str | None = None
) -> Iterator[tuple[argparse.Namespace, Path]]:
    """Parse the arguments, --dir among them; yield them with a temporary folder there.

    Args:
        parser: Has the other arguments.
        meaning: Help of --dir.
    """
    parser.add_argument('--dir', type=Path, help=meaning)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.dir) as name:
        yield given, Path(name)


def seconds(work: Callable[[], object]) -> float:
    """How long work takes."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def timed(out: Path, work: Callable[[], object], *, to_disk: bool = False) -> Run:
    """Time work, which makes out; to_disk counts until that is on the disk. It is removed then."""

    def whole() -> None:
        work()
        if to_disk:
            os.sync()

    fresh(out)
    os.sync()  # what an earlier run left to be written is not this one's burden
    run = Run(seconds(whole), tree_bytes(out))
    fresh(out)
    return run


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


def process(out: Path, *words: str, to_disk: bool = False) -> tuple[Run, float]:
    """A command of kitti-ros2 that makes out, start included; also its peak memory in MB."""
    peak = 0.0

    def work() -> None:
        nonlocal peak
        peak = peak_mb(*words)

    return timed(out, work, to_disk=to_disk), peak


def peak_mb(*words: str) -> float:
    """Run a command of kitti-ros2, and return its peak memory in MB."""
    child = os.posix_spawn(COMMAND[0], [*COMMAND, *words], os.environ)
    _, status, usage = os.wait4(child, 0)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f'{" ".join(words)} failed')
    return usage.ru_maxrss / 1000


def measure_memory(
    src: Path, longer: Path | None, bound: str, peak_mb: Callable[[Path, str], float]
) -> None:
    """Peak of a whole process, by drive and images, and whether a longer drive needs more."""
    for images in ('compressed', 'raw'):
        peak = peak_mb(src, images)
        report(f'peak memory, {images} images, MB', peak, bound, src.name)
        if longer is not None:
            grown = peak_mb(longer, images)
            report(f'the longer drive, {images} / this', grown / peak, '<= 1.1', f'{grown:.0f} MB')


def report(name: str, value: float, bound: str, note: str = '') -> None:
    """One line."""
    print(f'{name:<46}{value:8.2f}   {bound:<10} {note}', flush=True)
